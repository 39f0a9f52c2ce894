"""Writes stubs (.pyi), so that editors know the classes of the import hook and of `load`.

Pyright and Pylance find stubs in `typings/` without a setting, mypy with
`mypy_path = "typings"`. One stub replaces srvgen itself: it has an overload of `load` for every
type, and re-exports all other names.

The stubs of the packages that come with srvgen are committed: in `srvgen/stubs`, not under their
own names, which would hide the packages of an installed ROS. `srvgen.load` has overloads for them.
"""

from __future__ import annotations

import inspect
import keyword
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module

from .. import EXPORTS
from ..definitions.derived import references
from ..definitions.model import Definition, Kind
from ..definitions.names import split_type_name
from ..errors import DefinitionError
from ..files.reading import KINDS
from ..files.search import Search
from .generate import exports
from .render import GENERATED, render_stub
from .render_expressions import docstring, module_name

BUNDLED_STUBS = "srvgen.stubs."
"""Precedes the names of the modules of `bundled_stubs`."""


def packages_with_dependencies(
    names: Sequence[str], search: Search
) -> tuple[dict[str, Definition], list[DefinitionError]]:
    """All definitions of packages and of their dependencies, and the errors in them.

    A stub hides the whole package from a type checker, so all types of a package are included.

    Args:
        names: packages, or types whose packages are included; all packages if empty.
        search: finds the definitions.

    Raises:
        DefinitionError: a name cannot be found.
    """
    wanted = [_package(name, search) for name in names] or list(search.packages())
    known: dict[str, Definition] = {}
    problems: list[DefinitionError] = []
    seen: set[str] = set()
    while wanted:
        package = wanted.pop()
        if package in seen or keyword.iskeyword(package) or package in sys.stdlib_module_names:
            continue
        seen.add(package)
        for name in search.interfaces(package):
            try:
                needed = search.with_dependencies(name)
            except DefinitionError as error:
                problems.append(error)
            else:
                known[name] = needed[-1]
                wanted += [one.type.package or "" for one in references(needed[-1])]
    return dict(sorted(known.items())), problems


def stubs(definitions: Mapping[str, Definition]) -> dict[str, str]:
    """The stub files of these definitions and of srvgen itself, by relative path."""
    output = _packages(definitions, "")
    output["srvgen/__init__.pyi"] = _text(
        f'"""srvgen, with a `load` that knows the types of this project; {GENERATED}"""',
        *_overloads(definitions, "", _reexports()),
    )
    return dict(sorted(output.items()))


def bundled_stubs(definitions: Mapping[str, Definition]) -> dict[str, str]:
    """The stub files of `srvgen/stubs`: the packages, and a `load` with an overload for each type.

    Returns:
        Texts by path relative to this folder.
    """
    output = _packages(definitions, BUNDLED_STUBS)
    output["__init__.pyi"] = _text(
        f'"""`srvgen.load` with the types that come with srvgen; {GENERATED}"""',
        *_overloads(definitions, BUNDLED_STUBS),
    )
    return dict(sorted(output.items()))


def _packages(definitions: Mapping[str, Definition], home: str) -> dict[str, str]:
    folders: dict[tuple[str, Kind], list[str]] = {}
    output = {}
    for name, definition in definitions.items():
        package, kind, bare = split_type_name(name)
        folders.setdefault((package, kind), []).append(bare)
        output[f"{package}/{kind}/{module_name(bare)}.pyi"] = render_stub(definition, home)
        output[f"{package}/__init__.pyi"] = f'"""The interfaces of {package}, {GENERATED}"""\n'
    for (package, kind), names in folders.items():
        output[f"{package}/{kind}/__init__.pyi"] = exports(package, kind, names)
    return output


def _package(name: str, search: Search) -> str:
    if "/" in name:
        return search.existing_name(name).split("/")[0]
    search.interfaces(name)  # raises DefinitionError if there is no such package
    return name


def _text(*lines: str) -> str:
    return "\n".join(lines) + "\n"


def _reexports() -> Iterator[str]:
    for name, home in sorted(EXPORTS.items(), key=lambda one: (one[1], one[0])):
        if name != "load":
            yield f"from srvgen.{home} import {name} as {name}"


def _overloads(
    definitions: Mapping[str, Definition], home: str, imports: Iterable[str] = ()
) -> Iterator[str]:
    yield from ("# ruff: noqa", "", "from typing import Any, Literal, overload", "")
    folders = sorted({tuple(name.split("/")[:2]) for name in definitions})
    for package, kind in folders:
        yield f"from {home}{package} import {kind} as _{package}_{kind}"
    yield from (*imports, "")
    for name in definitions:
        package, kind, bare = name.split("/")
        literals = ", ".join(f'"{one}"' for one in _spellings(name, definitions))
        yield "@overload"
        yield f"def load(type_name: Literal[{literals}]) -> type[_{package}_{kind}.{bare}]: ..."
    load = import_module("srvgen.classes.loader").load
    text = docstring((inspect.getdoc(load) or "").splitlines(), "    ")
    yield from ("@overload", "def load(type_name: str) -> Any:", *text)


def _spellings(name: str, known: Mapping[str, Definition]) -> list[str]:
    package, kind, bare = name.split("/")
    others = [one for one in KINDS if one != kind and f"{package}/{one}/{bare}" in known]
    return [name] if others else [name, f"{package}/{bare}"]
