"""Definitions → the files of importable Python packages."""

from __future__ import annotations

import keyword
import sys
from collections.abc import Collection, Mapping, Sequence
from importlib.resources import files

from ..definitions.model import Definition, Kind, MessageDef
from ..definitions.names import names_in_folder
from ..errors import DefinitionError
from ..files.dependencies import Source, closure, full_text
from ..files.reading import KINDS
from ..typehash import Hasher
from .render import GENERATED, render
from .render_expressions import module_name, text_literal


def generate(
    packages: Mapping[str, Sequence[Definition]], search: Source, kept: Collection[str] = ()
) -> dict[str, str]:
    """The files of the given packages and of all that they need, by relative path.

    What they need comes along even where nobody named it (a service's events need
    `service_msgs`), so that the output stands alone: its folder on the path is enough. The same
    definitions give the same bytes.

    Args:
        packages: definitions by package.
        search: where the others are found.
        kept: full names of types that earlier runs have generated and that stay.

    Raises:
        DefinitionError: a nested type is not within reach, or two types need one module.
    """
    known: dict[str, Definition] = {}
    for definition in (one for package in packages.values() for one in package):
        known |= {one.full_name: one for one in closure(definition, search)}
    output: dict[str, str] = {}
    for name, definition in sorted(known.items()):
        _refuse_package(definition.package)
        path = "/".join((*name.split("/")[:2], f"{module_name(definition.name)}.py"))
        if path in output:
            raise DefinitionError(
                f"expected names that differ in more than capitals, got two types for {path}",
                hint=f"rename {name}",
            )
        output[path] = _source(definition, search)
    return dict(
        sorted((output | _frames({*known, *kept}, {one.package for one in known.values()})).items())
    )


def _refuse_package(name: str) -> None:
    if keyword.iskeyword(name):
        raise DefinitionError(
            f"expected a package that Python can import, got {name!r}, a word of its own",
            hint="srvgen.load loads such a type all the same",
        )
    if name in sys.stdlib_module_names or name == "msgspec":
        raise DefinitionError(
            f"expected a package name of its own, got {name!r}, which would hide Python's module"
        )


def _source(definition: Definition, search: Source) -> str:
    text = "" if isinstance(definition, MessageDef) else full_text(definition, search)
    needed = {one.full_name: one for one in closure(definition, search)}
    return render(definition, Hasher(needed.__getitem__), text).text


def _frames(types: Collection[str], packages: Collection[str]) -> dict[str, str]:
    """The files that make packages of the modules of these types."""
    runtime = runtime_source()
    output: dict[str, str] = {}
    for package in packages:
        output |= {
            f"{package}/__init__.py": f'"""The interfaces of {package}, {GENERATED}"""\n',
            f"{package}/_runtime.py": runtime,
            f"{package}/py.typed": "",
        }
        for kind in KINDS:
            folder = f"{package}/{kind}/"
            names = sorted(one.removeprefix(folder) for one in types if one.startswith(folder))
            if names:
                output[f"{package}/{kind}/__init__.py"] = exports(package, kind, names)
    return output


def runtime_source() -> str:
    """The source of the module that every generated package has a copy of."""
    return files("srvgen").joinpath("_runtime.py").read_text(encoding="utf-8")


def exports(package: str, kind: Kind, names: Sequence[str]) -> str:
    """The source of the folder module that has all the classes of one kind."""
    lines = [f'"""The {kind} interfaces of {package}, {GENERATED}"""']
    lines += ["# ruff: noqa", ""]
    classes = {name: names_in_folder(kind, name) for name in names}
    lines += sorted(
        f"from .{module_name(name)} import {', '.join(of)}" for name, of in classes.items()
    )
    exported = [one for of in classes.values() for one in of]
    lines += ["", "__all__ = [", *(f"    {text_literal(one)}," for one in exported), "]"]
    return "\n".join(lines) + "\n"
