"""Definitions → the files of importable Python packages."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from .closure import Source, closure, full_text
from .errors import DefinitionError
from .files import KINDS
from .model import Definition, MessageDef
from .render import GENERATED, render
from .render_text import text_literal
from .render_types import module_name
from .typehash import Hasher


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
    runtime = files(__package__).joinpath("_runtime.py").read_text(encoding="utf-8")
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


def exports(package: str, kind: str, names: Sequence[str]) -> str:
    """The source of the folder module that has all the classes of one kind."""
    lines = [f'"""The {kind} interfaces of {package}, {GENERATED}"""']
    lines += ["# ruff: noqa", ""]
    lines += sorted(f"from .{module_name(name)} import {name}" for name in names)
    lines += ["", "__all__ = [", *(f"    {text_literal(name)}," for name in names), "]"]
    return "\n".join(lines) + "\n"


def kept_types(folder: Path, is_gone: Callable[[str], bool]) -> set[str]:
    """The full names of the types that have modules in a folder, but for those that are gone."""
    made = (_made_from(path) for kind in KINDS for path in folder.glob(f"*/{kind}/_*.py"))
    return {name for name in made if name and not is_gone(name)}


def write_tree(
    files: Mapping[str, str], folder: Path, is_missing: Callable[[str], bool], *, check: bool
) -> list[str]:
    """Write files that srvgen generated; those that it once generated for nothing that is go.

    Args:
        files: texts by relative path.
        folder: where they belong.
        is_missing: whether the definition of this full name has gone, and its module with it.
        check: write nothing.

    Returns:
        What differed, a sentence a file, in order.

    Raises:
        DefinitionError: the folder cannot be written.
    """
    try:
        changed = {path: text for path, text in files.items() if _differs(folder / path, text)}
        packages = {path.split("/")[0] for path in files}
        stale = [
            path
            for package in sorted(packages)
            for path in _stale(folder / package, is_missing)
            if path.relative_to(folder).as_posix() not in files
        ]
        if not check:
            for path, text in changed.items():
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                (folder / path).write_bytes(text.encode())
            for one in stale:
                one.unlink()
    except OSError as error:
        raise DefinitionError(
            f"expected a folder to write to, got: {error.strerror or error}",
            path=str(error.filename or folder),
        ) from None
    return [
        *(f"{folder / path} is not up to date" for path in sorted(changed)),
        *(f"{path} belongs to no definition any more" for path in stale),
    ]


def _differs(path: Path, text: str) -> bool:
    return not path.is_file() or path.read_bytes() != text.encode()


def _stale(package: Path, is_missing: Callable[[str], bool]) -> Iterator[Path]:
    """The modules of a generated package whose definitions have gone."""
    for kind in KINDS:
        modules = sorted((package / kind).glob("_*.py*"))
        made = {path: _made_from(path) for path in modules if path.suffix in (".py", ".pyi")}
        gone = [path for path, name in made.items() if name and is_missing(name)]
        yield from gone
        if gone and not [path for path in made if path not in gone and path.stem != "__init__"]:
            # Nothing is left that the folder's own module could offer.
            yield from (path for path in made if path.stem == "__init__")


def _made_from(path: Path) -> str:
    """The full name of the type that srvgen generated a module for, or ""."""
    try:
        with path.open("rb") as file:
            line = file.readline(1000).decode(errors="replace")
    except OSError:  # a folder, a link to nothing: nothing of ours
        return ""
    found = re.match(rf'"""(\w+/\w+/\w+), {re.escape(GENERATED)}', line)
    return found[1] if found else ""
