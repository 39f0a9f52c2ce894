"""The `srvgen` command: generate, check, fix, describe, show, hash and stubs."""

from __future__ import annotations

import argparse
import io
import json
import logging
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from .arguments import Commands, Parser, add_command, root, with_sources, with_type
from .closure import closure, whole_error
from .describe import describe
from .errors import DefinitionError
from .files import KINDS, read_definition, read_text
from .fix import Fix, fix_file
from .model import Definition
from .report import Report
from .search import Search
from .show import Comments, show
from .sources import files_of, is_type_name, search_paths
from .suspicions import package_cycle, suspicions
from .typehash import hash_of


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0 done, 1 an error, 2 wrong usage."""
    parser = _parser()
    options = parser.parse_args(argv)
    if "run" not in options:
        parser.print_help(sys.stderr)
        return 2
    _print_notes()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Comments have characters that the code page of a Windows pipe may lack.
        sys.stdout.reconfigure(errors="backslashreplace")
    report = Report(as_json=getattr(options, "json", False))
    try:
        try:
            options.run(options, report)
        except DefinitionError as error:
            report.error(error)
        sys.stdout.flush()
        report.finish()
    except BrokenPipeError:
        # The reader of our output has gone, and Python must not trip over that at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        return 130
    return report.exit_code


def _parser() -> Parser:
    parser, commands = root()
    _add_generate(commands)
    check = with_sources(commands, "check", "report every problem of definitions", default=".")
    check.add_argument("--json", action="store_true", help="one JSON line a problem")
    check.set_defaults(run=_check)
    fix = with_sources(commands, "fix", "put right what has one right answer, and report the rest")
    fix.add_argument(
        "--dry-run", action="store_true", help="write nothing; print what would change as a diff"
    )
    fix.set_defaults(run=_fix)
    describe = with_sources(commands, "describe", "print definitions as JSON")
    describe.add_argument("--json", action="store_true", help="one line an interface")
    describe.set_defaults(run=_describe)
    _add_show(commands)
    digest = with_type(commands, "hash", "print the RIHS01 hash of a type")
    digest.add_argument("--json", action="store_true", help="as a JSON object")
    digest.set_defaults(run=_hash)
    _add_stubs(commands)
    return parser


def _add_generate(commands: Commands) -> None:
    command = with_sources(commands, "generate", "write importable Python packages")
    command.add_argument(
        "-o", dest="out", metavar="OUT", type=Path, required=True, help="the folder to write to"
    )
    command.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 if the output would differ"
    )
    command.set_defaults(run=_generate)


def _add_show(commands: Commands) -> None:
    command = with_type(commands, "show", "print a definition and what it contains")
    which = command.add_mutually_exclusive_group()
    which.add_argument(
        "--all-comments", action="store_true", help="with the comments of nested definitions"
    )
    which.add_argument("--no-comments", action="store_true", help="without any comments")
    command.set_defaults(run=_show)


_STUBS = """\
write stubs (.pyi), so that editors and type checkers know the classes that the import hook and
srvgen.load give, down to the name of each field"""
_STUBS_NOTES = """\
Pyright and Pylance read ./typings as it is; for mypy, set mypy_path = "typings". Afterwards
srvgen.load("my_msgs/srv/Fetch") is typed too, where the name is written out. Run it again when a
definition has changed. Pyright's warning reportMissingModuleSource, that there is a stub and no
source, is right: these packages have no Python files. It may be switched off."""


def _add_stubs(commands: Commands) -> None:
    command = add_command(commands, "stubs", "write stubs for editors and type checkers")
    command.description, command.epilog = _STUBS, _STUBS_NOTES
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


def _generate(options: argparse.Namespace, report: Report) -> None:
    from .generate import generate, kept_types, write_tree

    search = _search_of_sources(options)
    packages: dict[str, list[Definition]] = {}
    whole: set[str] = set()
    for source in options.sources:
        for path in _files([source], search, report):
            try:
                definition = read_definition(path)
                closure(definition, search, path=path)
                search.find(definition.full_name)
            except DefinitionError as error:
                # It is not valid, lacks something, or lies outside its package's folder.
                report.error(whole_error(error, search))
            else:
                packages.setdefault(definition.package, []).append(definition)
                if path != Path(source) and not is_type_name(source):
                    whole.add(definition.package)

    def is_gone(name: str) -> bool:
        # Who names single files, as with protoc, says nothing about those of earlier runs.
        return name.partition("/")[0] in whole and search.is_missing(name)

    files = generate(packages, search, kept_types(options.out, is_gone))
    differences = write_tree(files, options.out, is_gone, check=options.check)
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
    files = _files(options.sources, search, report)
    with search.one_look():
        for path in files:
            try:
                definition = read_definition(path)
                report.warn(suspicions(definition, path))
                known |= {one.full_name: one for one in closure(definition, search, path=path)}
            except DefinitionError as error:
                report.error(whole_error(error, search))
    if ring := package_cycle(known.values()):
        chain = " → ".join(ring)
        report.error(DefinitionError(f"expected packages that can be ordered, got {chain}"))
    if not report.exit_code and not options.json:
        warnings = f", {_counted(report.warnings, 'warning')}" if report.warnings else ""
        print(f"{_counted(len(files), 'definition')}, no problems{warnings}")


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _fix(options: argparse.Namespace, report: Report) -> None:
    search = _search_of_sources(options)
    fixes: list[Fix] = []
    for path in _files(options.sources, search, report):
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
            # What would be written is not what is there, to which other problems would point.
            report.error(error if options.dry_run else whole_error(error, search))


def _describe(options: argparse.Namespace, report: Report) -> None:
    search = _search_of_sources(options)
    for source in options.sources:
        if is_type_name(source):  # perhaps of one that its file implies
            readers = [partial(search.load, source)]
        else:
            readers = [partial(read_definition, path) for path in _files([source], search, report)]
        for read in readers:
            try:
                described = describe(read())
            except DefinitionError as error:
                report.error(error)
            else:
                indent = None if options.json else 2
                print(json.dumps(described, indent=indent, allow_nan=False))


def _show(options: argparse.Namespace, report: Report) -> None:
    search, definition, path = _one(options)

    def lookup(name: str) -> tuple[str, Definition]:
        if path and name == definition.full_name:
            return read_text(path), definition
        return search.text(name), search.load(name)

    comments: Comments = "all" if options.all_comments else "none" if options.no_comments else "own"
    for line in show(definition.full_name, lookup, comments=comments):
        print(line)


def _hash(options: argparse.Namespace, report: Report) -> None:
    search, definition, path = _one(options)
    name = definition.full_name
    if not path:
        name = str(search.resolve_name(options.type))
        definition = search.load(name)
    digest = hash_of(definition, search.load)
    print(json.dumps({"type": name, "hash": digest}) if options.json else digest)


def _one(options: argparse.Namespace) -> tuple[Search, Definition, Path | None]:
    """The one definition that is asked for, with all that it needs; its file if that was named."""
    path = Path(options.type)
    search = Search([*search_paths([options.type]), *options.include])
    if path.is_file():
        definition = read_definition(path)
        closure(definition, search, path=path)
        return search, definition, path
    if path.is_dir():
        raise DefinitionError("expected a file or the name of a type, got a folder", path=str(path))
    if path.suffix.removeprefix(".") in KINDS:
        files_of(options.type, search)  # says that there is none, and what is
    name = search.resolve_name(options.type)
    owner = str(name._replace(name=search.find(str(name)).stem))
    return search, search.closure(owner)[-1], None


def _search_of_sources(options: argparse.Namespace) -> Search:
    # What is to be worked on goes before a package of the same name on a search path.
    return Search([*search_paths(options.sources), *options.include])


def _files(sources: Sequence[str], search: Search, report: Report) -> list[Path]:
    """The files of the sources, each once."""
    paths: dict[Path, Path] = {}
    for source in sources:
        try:
            for path in files_of(source, search):
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
