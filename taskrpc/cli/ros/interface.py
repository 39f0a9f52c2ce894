"""`taskrpc interface`: show, list, package, packages and proto, as in `ros2 interface`."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from taskrpc.cli.shared import definitions
from taskrpc.cli.shared.command import Exit, NotFound, UsageError, hinted, standard_input
from taskrpc.cli.shared.parsing import Commands, add_command, add_group, print_names

if TYPE_CHECKING:
    from srvgen.describe import Comments

_HEADINGS = {"msg": "Messages:", "srv": "Services:", "action": "Actions:"}


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the commands about interfaces."""
    commands = add_group(parser)
    _add_list(commands)
    _add_package(commands)
    _add_packages(commands)
    _add_proto(commands)
    _add_show(commands)


def _add_list(commands: Commands) -> None:
    parser = add_command(commands, "list", "List all interface types available")
    _add_kinds(parser, "Print out only the {} types")
    parser.set_defaults(run=_list)


def _add_package(commands: Commands) -> None:
    parser = add_command(commands, "package", "Output a list of the interfaces of one package")
    _add_kinds(parser, "Print out only the {} types")
    parser.add_argument("package_name", help="Name of the package (e.g. 'example_interfaces')")
    parser.set_defaults(run=_package)


def _add_packages(commands: Commands) -> None:
    parser = add_command(commands, "packages", "Output a list of packages that have interfaces")
    _add_kinds(parser, "Only list packages that have {} types")
    parser.set_defaults(run=_packages)


def _add_proto(commands: Commands) -> None:
    parser = add_command(commands, "proto", "Output an interface prototype")
    parser.add_argument("type", help="Type to show (e.g. 'example_interfaces/srv/AddTwoInts')")
    what = "Output without the outer quotes"
    parser.add_argument("--no-quotes", action="store_true", help=what)
    _add_json(parser)
    parser.set_defaults(run=_proto)


def _add_show(commands: Commands) -> None:
    parser = add_command(commands, "show", "Output the interface definition")
    what = "Type to show (e.g. 'example_interfaces/srv/AddTwoInts'); - reads it from standard input"
    parser.add_argument("type", help=what)
    which = parser.add_mutually_exclusive_group()
    what = "Show all comments, also those of nested types"
    which.add_argument("--all-comments", action="store_true", help=what)
    what = "Show no comments and no blank lines"
    which.add_argument("--no-comments", action="store_true", help=what)
    parser.set_defaults(run=_show)


def _add_kinds(parser: argparse.ArgumentParser, what: str) -> None:
    for option, kind, noun in (
        ("msgs", "msg", "message"),
        ("srvs", "srv", "service"),
        ("actions", "action", "action"),
    ):
        parser.add_argument(
            f"-{option[0]}",
            f"--only-{option}",
            dest="kinds",
            action="append_const",
            const=kind,
            help=what.format(noun),
        )
    _add_json(parser)


def _kinds(options: argparse.Namespace) -> list[str]:
    """Return the kinds that the options of `_add_kinds` select, in ros2's order."""
    return [kind for kind in _HEADINGS if kind in (options.kinds or _HEADINGS)]


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="Print JSON")


def _list(options: argparse.Namespace) -> int:
    search = definitions.search()
    found: dict[str, list[str]] = {kind: [] for kind in _kinds(options)}
    for package in search.packages():
        for name in search.interfaces(package):
            found.get(name.split("/")[1], []).append(name)
    if options.json:
        return print_names([name for group in found.values() for name in group], as_json=True)
    for kind, group in found.items():
        print(_HEADINGS[kind])
        for name in sorted(group):
            print(f"    {name}")
    return Exit.DONE


def _package(options: argparse.Namespace) -> int:
    search = definitions.search()
    if options.package_name not in search.packages():
        from srvgen.definitions.names import did_you_mean

        hint = did_you_mean(options.package_name, search.packages())
        raise hinted(NotFound(f"Unknown package '{options.package_name}'"), hint)
    kinds = _kinds(options)
    found = search.interfaces(options.package_name)
    wanted = sorted(name for name in found if name.split("/")[1] in kinds)
    return print_names(wanted, as_json=options.json)


def _packages(options: argparse.Namespace) -> int:
    search = definitions.search()
    kinds = set(_kinds(options))
    found = [
        package
        for package in search.packages()
        if kinds & {name.split("/")[1] for name in search.interfaces(package)}
    ]
    return print_names(found, as_json=options.json)


def _proto(options: argparse.Namespace) -> int:
    import yaml

    import srvgen

    found: Any = definitions.load(options.type)
    cls = getattr(found, "Request", None) or getattr(found, "Goal", None) or found
    fields = srvgen.to_builtins(cls())
    if options.json:
        print(json.dumps(fields))
        return Exit.DONE
    text = yaml.safe_dump(fields, sort_keys=False, allow_unicode=True)
    print(text if options.no_quotes else f'"{text}"')
    return Exit.DONE


def _show(options: argparse.Namespace) -> int:
    from srvgen.describe import show

    search = definitions.search()
    name = search.resolve_name(_piped() if options.type == "-" else options.type)
    owner = str(name._replace(name=search.find(str(name)).stem))
    search.with_dependencies(owner)
    comments: Comments = "all" if options.all_comments else "none" if options.no_comments else "own"
    for line in show(owner, lambda one: (search.text(one), search.load(one)), comments=comments):
        print(line)
    return Exit.DONE


def _piped() -> str:
    """Read a type from standard input, for example from `taskrpc topic type /chatter`."""
    if sys.stdin is not None and sys.stdin.isatty():
        raise UsageError(
            "expected a type on standard input, for example: taskrpc topic type NAME | …"
        )
    return standard_input().strip().partition("\n")[0].strip()
