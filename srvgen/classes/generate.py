"""Makes the files of importable Python packages from definitions; `output` writes them."""

from __future__ import annotations

import keyword
import sys
from collections.abc import Collection, Mapping, Sequence
from importlib.resources import files

from ..definitions.model import Definition, Kind, MessageDef
from ..definitions.names import names_in_folder
from ..errors import DefinitionError
from ..files.dependencies import DefinitionSource, full_text, with_dependencies
from ..files.reading import KINDS
from ..typehash import Hasher
from .render import GENERATED, render
from .render_expressions import module_name, text_literal


def generate(
    packages: Mapping[str, Sequence[Definition]],
    search: DefinitionSource,
    kept: Collection[str] = (),
) -> dict[str, str]:
    """The files of the given packages and of all their dependencies, by relative path.

    The output is complete: only its folder must be on the Python path. It also has dependencies
    of derived types, such as `service_msgs` for the events of a service. The same definitions
    give the same bytes.

    Args:
        packages: definitions by package.
        search: provides the dependencies.
        kept: full names of types that earlier runs have generated and that are kept.

    Raises:
        DefinitionError: a nested type cannot be found, or two types need the same module.
    """
    known: dict[str, Definition] = {}
    for definition in (one for package in packages.values() for one in package):
        known |= {one.full_name: one for one in with_dependencies(definition, search)}
    output: dict[str, str] = {}
    for name, definition in sorted(known.items()):
        _refuse_package(definition.package)
        path = "/".join((*name.split("/")[:2], f"{module_name(definition.name)}.py"))
        if path in output:
            raise DefinitionError(
                f"expected type names that differ not only in capitals, got two types for {path}",
                hint=f"rename {name}",
            )
        output[path] = _source(definition, search)
    return dict(
        sorted((output | _frames({*known, *kept}, {one.package for one in known.values()})).items())
    )


def _refuse_package(name: str) -> None:
    if keyword.iskeyword(name):
        raise DefinitionError(
            f"expected a package that Python can import, got {name!r}, a keyword",
            hint="srvgen.load can still load such a type",
        )
    if name in sys.stdlib_module_names or name == "msgspec":
        raise DefinitionError(
            f"expected another package name, got {name!r}, which would hide a module of Python"
        )


def _source(definition: Definition, search: DefinitionSource) -> str:
    text = "" if isinstance(definition, MessageDef) else full_text(definition, search)
    needed = {one.full_name: one for one in with_dependencies(definition, search)}
    return render(definition, Hasher(needed.__getitem__), text).text


def _frames(types: Collection[str], packages: Collection[str]) -> dict[str, str]:
    """The files beside the modules: `__init__`, the runtime and `py.typed`."""
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
    """The source of `_runtime`, which is copied into every generated package."""
    return files("srvgen").joinpath("_runtime.py").read_text(encoding="utf-8")


def exports(package: str, kind: Kind, names: Sequence[str]) -> str:
    """The source of `PACKAGE/KIND/__init__.py`, which exports all classes of one kind."""
    lines = [f'"""The {kind} interfaces of {package}, {GENERATED}"""']
    lines += ["# ruff: noqa", ""]
    classes = {name: names_in_folder(kind, name) for name in names}
    exported = [one for of in classes.values() for one in of]
    # A stub exports only a name that it imports with `as`; Jedi ignores `__all__` there.
    imported = {one: f"{one} as {one}" for one in exported}
    lines += sorted(
        f"from .{module_name(name)} import {', '.join(imported[one] for one in of)}"
        for name, of in classes.items()
    )
    lines += ["", "__all__ = [", *(f"    {text_literal(one)}," for one in exported), "]"]
    return "\n".join(lines) + "\n"
