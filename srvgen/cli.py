"""The `srvgen` command: generate, check, fix, describe, show, hash and stubs."""

from __future__ import annotations

import argparse
import io
import json
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from .closure import closure
from .describe import describe
from .errors import DefinitionError
from .files import read_definition
from .fix import Fix, fix_file
from .model import Definition
from .report import Report
from .search import Search
from .show import Comments, show
from .sources import definition_files, search_paths
from .suspicions import package_cycle, suspicions
from .typehash import hash_of


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0 done, 1 an error, 2 wrong usage."""
    options = _parser().parse_args(argv)
    _print_notes()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Comments have characters that the code page of a Windows pipe may lack.
        sys.stdout.reconfigure(errors="backslashreplace")
    report = Report(as_json=getattr(options, "json", False))
    try:
        options.run(options, report)
        sys.stdout.flush()
    except DefinitionError as error:
        report.error(error)
    except BrokenPipeError:
        # The reader of our output has gone, and Python must not trip over that at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        return 130
    return report.exit_code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="srvgen", description="ROS 2 interface definitions in Python, without ROS."
    )
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "-I",
        dest="include",
        metavar="PATH",
        type=Path,
        action="append",
        default=[],
        help="look for packages here first (may be repeated)",
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for add in (
        _add_generate,
        _add_check,
        _add_fix,
        _add_describe,
        _add_show,
        _add_hash,
        _add_stubs,
    ):
        add(commands, common)
    return parser


_Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def _add_generate(commands: _Commands, common: argparse.ArgumentParser) -> None:
    command = _with_sources(commands, common, "generate", "write importable Python packages")
    command.add_argument(
        "-o", dest="out", metavar="OUT", type=Path, required=True, help="the folder to write to"
    )
    command.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 if the output would differ"
    )
    command.set_defaults(run=_generate)


def _add_check(commands: _Commands, common: argparse.ArgumentParser) -> None:
    command = _with_sources(commands, common, "check", "report every problem of definitions")
    command.add_argument("--json", action="store_true", help="one JSON line a problem")
    command.set_defaults(run=_check)


def _add_fix(commands: _Commands, common: argparse.ArgumentParser) -> None:
    command = _with_sources(
        commands, common, "fix", "put right what has one right answer, and report the rest"
    )
    command.add_argument(
        "--dry-run", action="store_true", help="write nothing; print what would change as a diff"
    )
    command.set_defaults(run=_fix)


def _add_describe(commands: _Commands, common: argparse.ArgumentParser) -> None:
    command = _with_sources(commands, common, "describe", "print definitions as JSON")
    command.add_argument("--json", action="store_true", help="one line an interface")
    command.set_defaults(run=_describe)


def _add_show(commands: _Commands, common: argparse.ArgumentParser) -> None:
    command = _with_type(commands, common, "show", "print a definition and what it contains")
    which = command.add_mutually_exclusive_group()
    which.add_argument(
        "--all-comments", action="store_true", help="with the comments of nested definitions"
    )
    which.add_argument("--no-comments", action="store_true", help="without any comments")
    command.set_defaults(run=_show)


def _add_hash(commands: _Commands, common: argparse.ArgumentParser) -> None:
    command = _with_type(commands, common, "hash", "print the RIHS01 hash of a type")
    command.add_argument("--json", action="store_true", help="as a JSON object")
    command.set_defaults(run=_hash)


_STUBS = """\
write stubs (.pyi), so that editors and type checkers know the classes that the import hook and
srvgen.load give, down to the name of each field"""
_STUBS_NOTES = """\
Pyright and Pylance read ./typings as it is; for mypy, set mypy_path = "typings". Afterwards
srvgen.load("my_msgs/srv/Fetch") is typed too, where the name is written out. Run it again when a
definition has changed. Pyright's warning reportMissingModuleSource, that there is a stub and no
source, is right: these packages have no Python files. It may be switched off."""


def _add_stubs(commands: _Commands, common: argparse.ArgumentParser) -> None:
    command = commands.add_parser(
        "stubs",
        parents=[common],
        help="write stubs for editors and type checkers",
        description=_STUBS,
        epilog=_STUBS_NOTES,
    )
    command.add_argument(
        "names",
        metavar="TYPE|PACKAGE",
        nargs="*",
        help="what to write stubs for, with all that it needs (default: every package in reach)",
    )
    command.add_argument(
        "-o",
        dest="out",
        metavar="DIR",
        type=Path,
        default=Path("typings"),
        help="the folder to write to (default: typings)",
    )
    command.set_defaults(run=_stubs)


def _with_sources(
    commands: _Commands, common: argparse.ArgumentParser, name: str, purpose: str
) -> argparse.ArgumentParser:
    command = commands.add_parser(name, parents=[common], help=purpose, description=purpose)
    command.add_argument(
        "sources",
        metavar="SRC",
        nargs="+",
        type=Path,
        help="a definition file, a package folder or a folder of packages",
    )
    return command


def _with_type(
    commands: _Commands, common: argparse.ArgumentParser, name: str, purpose: str
) -> argparse.ArgumentParser:
    command = commands.add_parser(name, parents=[common], help=purpose, description=purpose)
    command.add_argument("type", metavar="TYPE", help="such as example_interfaces/srv/AddTwoInts")
    return command


def _generate(options: argparse.Namespace, report: Report) -> None:
    from .generate import generate, write_tree

    search = _search_of_sources(options)
    packages: dict[str, list[Definition]] = {}
    for definition in _complete(options, search, report):
        try:
            search.find(definition.full_name)
        except DefinitionError as error:
            report.error(error)  # the file does not lie in its package's folder
        else:
            packages.setdefault(definition.package, []).append(definition)
    files = generate(packages, search)
    differences = write_tree(files, options.out, search.is_missing, check=options.check)
    if options.check:
        for difference in differences:
            report.failure(f"{difference}: run srvgen generate")


def _stubs(options: argparse.Namespace, report: Report) -> None:
    from .generate import write_tree
    from .stubs import stubs, whole_packages

    search = Search(options.include)
    definitions, problems = whole_packages(options.names, search)
    for problem in problems:
        report.error(problem)
    write_tree(stubs(definitions), options.out, search.is_missing, check=False)
    packages = {name.split("/")[0] for name in definitions}
    types = f"{_counted(len(definitions), 'type')} of {_counted(len(packages), 'package')}"
    print(f"wrote stubs for {types} to {options.out}")


def _check(options: argparse.Namespace, report: Report) -> None:
    search = _search_of_sources(options)
    known: dict[str, Definition] = {}
    count = 0
    for path, definition in _readable(options, report):
        count += 1
        report.warn(suspicions(definition, path))
        try:
            known |= {one.full_name: one for one in closure(definition, search, path=path)}
        except DefinitionError as error:
            report.error(error)
    if ring := package_cycle(known.values()):
        chain = " → ".join(ring)
        report.error(DefinitionError(f"expected packages that can be ordered, got {chain}"))
    if not report.exit_code and not options.json:
        warnings = f", {_counted(report.warnings, 'warning')}" if report.warnings else ""
        print(f"{_counted(count, 'definition')}, no problems{warnings}")


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _fix(options: argparse.Namespace, report: Report) -> None:
    search = _search_of_sources(options)
    fixes: list[Fix] = []
    for path in _files(options, report):
        try:
            fix = fix_file(path, search.is_missing)
            fixes.append(fix)
            if not fix.is_needed:
                continue
            if options.dry_run:
                print(*fix.diff(), sep="\n")
            else:
                fix.write()
                renamed = f", now {fix.new_path}" if fix.new_path != path else ""
                print(f"fixed {path}{renamed}")
        except DefinitionError as error:
            report.error(error)
    for fix in fixes:
        report.remember(fix.new_path)
        try:
            fix.check(search)
        except DefinitionError as error:
            report.error(error)


def _describe(options: argparse.Namespace, report: Report) -> None:
    for _, definition in _readable(options, report):
        print(json.dumps(describe(definition), indent=None if options.json else 2, allow_nan=False))


def _show(options: argparse.Namespace, report: Report) -> None:
    search = Search(options.include)
    name = search.resolve_name(options.type)
    owner = str(name._replace(name=search.find(str(name)).stem))
    search.closure(owner)
    comments: Comments = "all" if options.all_comments else "none" if options.no_comments else "own"
    for line in show(owner, lambda one: (search.text(one), search.load(one)), comments=comments):
        print(line)


def _hash(options: argparse.Namespace, report: Report) -> None:
    search = Search(options.include)
    name = str(search.resolve_name(options.type))
    search.closure(name)
    digest = hash_of(search.load(name), search.load)
    print(json.dumps({"type": name, "hash": digest}) if options.json else digest)


def _search_of_sources(options: argparse.Namespace) -> Search:
    # What is to be worked on goes before a package of the same name on a search path.
    return Search([*search_paths(options.sources), *options.include])


def _complete(options: argparse.Namespace, search: Search, report: Report) -> Iterator[Definition]:
    """The definitions of the sources for which everything that they need is there."""
    for path, definition in _readable(options, report):
        try:
            closure(definition, search, path=path)
        except DefinitionError as error:
            report.error(error)
        else:
            yield definition


def _readable(options: argparse.Namespace, report: Report) -> Iterator[tuple[Path, Definition]]:
    """The files of the sources that can be parsed; the others are reported."""
    for path in _files(options, report):
        try:
            yield path, read_definition(path)
        except DefinitionError as error:
            report.error(error)


def _files(options: argparse.Namespace, report: Report) -> list[Path]:
    """The files of the sources, each once."""
    paths: dict[Path, Path] = {}
    for source in options.sources:
        try:
            for path in definition_files(source):
                paths.setdefault(path.resolve(), path)
                report.remember(path)
        except DefinitionError as error:
            report.error(error)
    return list(paths.values())


def _print_notes() -> None:
    """Show what the library has to say, one line each, on stderr."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("note: %(message)s"))
    logger = logging.getLogger("srvgen")
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)
    logger.propagate = False
