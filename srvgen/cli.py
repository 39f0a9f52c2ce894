"""The `srvgen` command: generate, check, describe, show and hash interface definitions."""

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

from .closure import closure, problems_of
from .describe import describe
from .errors import DefinitionError
from .files import read_definition
from .model import Definition
from .search import Search
from .show import Comments, show
from .sources import definition_files, search_paths
from .typehash import hash_of


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0 done, 1 an error, 2 wrong usage."""
    options = _parser().parse_args(argv)
    _print_notes()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Comments have characters that the code page of a Windows pipe may lack.
        sys.stdout.reconfigure(errors="backslashreplace")
    report = _Report(as_json=getattr(options, "json", False))
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


class _Report:
    """Prints problems to stderr, each once, and knows what the exit code will be."""

    def __init__(self, *, as_json: bool) -> None:
        self.exit_code = 0
        self._as_json = as_json
        self._printed: set[str] = set()
        self._names: dict[str, str] = {}

    def remember(self, path: Path) -> None:
        """Call this file as the user did, whoever finds a problem in it."""
        self._names.setdefault(str(path.resolve()), str(path))

    def error(self, error: DefinitionError) -> None:
        self.exit_code = 1
        for problem in problems_of(error):
            problem.path = self._names.get(problem.path, problem.path)
            text = self._json(problem) if self._as_json else _positioned(problem)
            if text not in self._printed:
                self._printed.add(text)
                print(text, file=sys.stderr)

    def failure(self, sentence: str) -> None:
        self.exit_code = 1
        print(sentence, file=sys.stderr)

    def _json(self, problem: DefinitionError) -> str:
        fields = ("message", "path", "line", "column", "hint")
        given = {name: value for name in fields if (value := getattr(problem, name))}
        return json.dumps({"error": type(problem).__name__, **given})


def _positioned(problem: DefinitionError) -> str:
    """The problem as text; one of a whole file stands at its beginning, for editors to jump to."""
    if not problem.path or problem.line:
        return str(problem)
    return str(
        DefinitionError(problem.message, path=problem.path, line=1, column=1, hint=problem.hint)
    )


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
    for add in (_add_generate, _add_check, _add_describe, _add_show, _add_hash):
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


def _generate(options: argparse.Namespace, report: _Report) -> None:
    from .generate import generate

    search = _search_of_sources(options)
    packages: dict[str, list[Definition]] = {}
    for definition in _complete(options, search, report):
        try:
            search.find(definition.full_name)
        except DefinitionError as error:
            report.error(error)  # the file does not lie in its package's folder
        else:
            packages.setdefault(definition.package, []).append(definition)
    for relative, text in generate(packages, search).items():
        path = options.out / relative
        data = text.encode()
        if path.is_file() and path.read_bytes() == data:
            continue
        if options.check:
            report.failure(f"{path} is not up to date: run srvgen generate")
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _check(options: argparse.Namespace, report: _Report) -> None:
    search = _search_of_sources(options)
    count = len(list(_complete(options, search, report)))
    if not report.exit_code and not options.json:
        print(f"{count} definition{'s' if count > 1 else ''}, no problems")


def _describe(options: argparse.Namespace, report: _Report) -> None:
    for _, definition in _readable(options, report):
        print(json.dumps(describe(definition), indent=None if options.json else 2, allow_nan=False))


def _show(options: argparse.Namespace, report: _Report) -> None:
    search = Search(options.include)
    name = search.resolve_name(options.type)
    owner = str(name._replace(name=search.find(str(name)).stem))
    search.closure(owner)
    comments: Comments = "all" if options.all_comments else "none" if options.no_comments else "own"
    for line in show(owner, lambda one: (search.text(one), search.load(one)), comments=comments):
        print(line)


def _hash(options: argparse.Namespace, report: _Report) -> None:
    search = Search(options.include)
    name = str(search.resolve_name(options.type))
    search.closure(name)
    digest = hash_of(search.load(name), search.load)
    print(json.dumps({"type": name, "hash": digest}) if options.json else digest)


def _search_of_sources(options: argparse.Namespace) -> Search:
    # What is to be worked on goes before a package of the same name on a search path.
    return Search([*search_paths(options.sources), *options.include])


def _complete(options: argparse.Namespace, search: Search, report: _Report) -> Iterator[Definition]:
    """The definitions of the sources for which everything that they need is there."""
    for path, definition in _readable(options, report):
        try:
            closure(definition, search, path=path)
        except DefinitionError as error:
            report.error(error)
        else:
            yield definition


def _readable(options: argparse.Namespace, report: _Report) -> Iterator[tuple[Path, Definition]]:
    """The files of the sources that can be parsed; the others are reported."""
    paths: dict[Path, Path] = {}
    for source in options.sources:
        try:
            for path in definition_files(source):
                paths.setdefault(path.resolve(), path)
                report.remember(path)
        except DefinitionError as error:
            report.error(error)
    for path in paths.values():
        try:
            yield path, read_definition(path)
        except DefinitionError as error:
            report.error(error)


def _print_notes() -> None:
    """Show what the library has to say, one line each, on stderr."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("note: %(message)s"))
    logger = logging.getLogger("srvgen")
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)
    logger.propagate = False
