"""One function for each command of `srvgen`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..definitions.model import Definition
from ..errors import DefinitionError
from ..files.dependencies import error_with_dependencies, with_dependencies
from ..files.reading import KINDS, kind_folder, read_definition, read_text
from ..files.search import Search
from .report import Report
from .sources import files_of, is_type_name, search_paths

if TYPE_CHECKING:
    from ..classes.output import FolderChanges
    from ..files.fix import Fix


def write_packages(options: argparse.Namespace, report: Report) -> None:
    """`srvgen generate`: write importable Python packages."""
    search = _search_of_sources(options)
    with search.cached_lookups():
        _generate(options, report, search)


def _generate(options: argparse.Namespace, report: Report, search: Search) -> None:
    from ..classes.generate import generate
    from ..classes.output import kept_types, write_tree

    packages: dict[str, list[Definition]] = {}
    whole: set[str] = set()
    has_workspace = False
    for source in options.sources:
        for path in _files([source], search, report):
            has_workspace |= Path(source) in path.parents[2:]  # above package and kind
            try:
                definition = read_definition(path)
                with_dependencies(definition, search, path=path)
                search.find(definition.full_name)
            except DefinitionError as error:
                # The file is invalid, lacks a dependency, or is not in a package folder.
                report.error(error_with_dependencies(error, search))
            else:
                packages.setdefault(definition.package, []).append(definition)
                if path != Path(source) and not is_type_name(source):
                    whole.add(definition.package)

    def is_gone(name: str) -> bool:
        # With single files as sources, the types of earlier runs are kept, as with protoc.
        # A workspace contains all its packages, so a package that is not found was removed.
        is_meant = has_workspace or name.partition("/")[0] in whole
        return is_meant and search.is_missing(name)

    files = generate(packages, search, kept_types(options.out, is_gone))
    changes = write_tree(files, options.out, is_gone, check=options.check)
    if options.check:
        _report_differences(changes, report)
    else:
        for package in changes.gone:
            stays = "; other files in it are kept" if package.exists() else ""
            print(f"removed {package}, which no longer has definitions{stays}")


def _report_differences(changes: FolderChanges, report: Report) -> None:
    for path in changes.outdated:
        report.failure(f"{path} is not up to date: run srvgen generate")
    for path in (*changes.stale, *changes.gone):
        report.failure(f"{path} no longer has a definition: run srvgen generate")


def write_stubs(options: argparse.Namespace, report: Report) -> None:
    """`srvgen stubs`: write stubs for editors and type checkers."""
    from ..classes.output import write_tree
    from ..classes.stubs import packages_with_dependencies, stubs

    search = Search(options.include)
    definitions, problems = packages_with_dependencies(options.names, search)
    for problem in problems:
        report.error(problem)
    packages = {name.split("/")[0] for name in definitions}

    def is_gone(name: str) -> bool:
        return name.split("/", maxsplit=1)[0] in packages and search.is_missing(name)

    with search.cached_lookups():
        write_tree(stubs(definitions), options.out, is_gone, check=False)
    types = f"{_counted(len(definitions), 'type')} of {_counted(len(packages), 'package')}"
    print(f"wrote stubs for {types} to {options.out}")


def check(options: argparse.Namespace, report: Report) -> None:
    """`srvgen check`: report every problem in definitions."""
    from ..files.warnings import file_warnings, package_cycle

    search = _search_of_sources(options)
    known: dict[str, Definition] = {}
    files = _files(options.sources, search, report)
    with search.cached_lookups():
        for path in files:
            try:
                definition = read_definition(path)
                report.warn(file_warnings(definition, path))
                known |= {
                    one.full_name: one for one in with_dependencies(definition, search, path=path)
                }
            except DefinitionError as error:
                report.error(error_with_dependencies(error, search))
    if ring := package_cycle(known.values()):
        chain = " → ".join(ring)
        report.error(
            DefinitionError(f"expected packages without circular dependencies, got {chain}")
        )
    if not report.exit_code and not options.json:
        warnings = f", {_counted(report.warnings, 'warning')}" if report.warnings else ""
        print(f"{_counted(len(files), 'definition')}, no problems{warnings}")


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def fix(options: argparse.Namespace, report: Report) -> None:
    """`srvgen fix`: correct mistakes with one possible correction, and report the others."""
    from ..files.fix import fix_file

    search = _search_of_sources(options)
    fixes: list[Fix] = []
    with search.cached_lookups():
        for path in _files(options.sources, search, report):
            try:
                fix = fix_file(path, search.is_missing)
                fixes.append(fix)
                if fix.is_needed:
                    _apply(fix, path, dry_run=options.dry_run)
            except DefinitionError as error:
                report.error(error)
    with search.cached_lookups():  # files may have other names now
        for fix in fixes:
            report.remember(fix.new_path)
            try:
                fix.check(search)
            except DefinitionError as error:
                # With --dry-run the file is unchanged: positions of other problems would be wrong.
                report.error(error if options.dry_run else error_with_dependencies(error, search))


def _apply(fix: Fix, path: Path, *, dry_run: bool) -> None:
    if dry_run:
        print(*fix.diff(), sep="\n")
        return
    fix.write()
    renamed = f", now {fix.new_path}" if fix.new_path != path else ""
    print(f"fixed {path}{renamed}")


def print_descriptions(options: argparse.Namespace, report: Report) -> None:
    """`srvgen describe`: print definitions as JSON."""
    import json

    from ..describe import describe

    search = _search_of_sources(options)
    for source in options.sources:
        if is_type_name(source):  # it may be a derived type
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


def print_definition(options: argparse.Namespace, report: Report) -> None:
    """`srvgen show`: print a definition with its nested definitions."""
    from ..describe import Comments, show

    search, definition, path = _requested_type(options)

    def lookup(name: str) -> tuple[str, Definition]:
        if path and name == definition.full_name:
            return read_text(path), definition
        return search.text(name), search.load(name)

    comments: Comments = "all" if options.all_comments else "none" if options.no_comments else "own"
    for line in show(definition.full_name, lookup, comments=comments):
        print(line)


def print_hash(options: argparse.Namespace, report: Report) -> None:
    """`srvgen hash`: print the RIHS01 hash of a type."""
    import json

    from ..typehash import hash_of

    search, definition, path = _requested_type(options)
    name = definition.full_name
    if not path:
        name = str(search.resolve_name(options.type))
        definition = search.load(name)
    digest = hash_of(definition, search.load)
    print(json.dumps({"type": name, "hash": digest}) if options.json else digest)


def _requested_type(options: argparse.Namespace) -> tuple[Search, Definition, Path | None]:
    """The definition of the argument, checked with its dependencies, and a given file."""
    path = Path(options.type)
    search = Search([*search_paths([options.type]), *options.include])
    if path.is_file():
        definition = read_definition(path)
        with_dependencies(definition, search, path=path)
        return search, definition, path
    if path.is_dir():
        raise DefinitionError("expected a file or the name of a type, got a folder", path=str(path))
    if path.suffix.removeprefix(".") in KINDS:
        files_of(options.type, search)  # raises DefinitionError with similar files
    name = search.resolve_name(options.type)
    owner = str(name.renamed(search.find(str(name)).stem))
    return search, search.with_dependencies(owner)[-1], None


def _search_of_sources(options: argparse.Namespace) -> Search:
    # The sources come before packages of the same name on a search path.
    return Search([*search_paths(options.sources), *options.include])


def _duplicate(path: Path, first: Path) -> DefinitionError:
    return DefinitionError(
        f"expected only one file that defines {path.stem}, got a second one",
        path=str(path),
        hint=f"the other is {first}: rename or remove one; subfolders do not change the name",
    )


def _files(sources: Sequence[str], search: Search, report: Report) -> list[Path]:
    """The files of the sources, each once; two files that define the same type are an error."""
    paths: dict[Path, Path] = {}
    first: dict[tuple[Path, str], Path] = {}
    for source in sources:
        try:
            for path in files_of(source, search):
                real = path.resolve()
                paths.setdefault(real, path)
                report.remember(path)
                twin = first.setdefault((kind_folder(real) or real.parent, path.name), path)
                if twin.resolve() != real:
                    report.error(_duplicate(path, twin))
        except DefinitionError as error:
            report.error(error)
    return list(paths.values())
