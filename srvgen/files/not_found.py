"""What is said about a type or a package that is not within reach."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from ..definitions.names import (
    TypeName,
    did_you_mean,
    is_message_name,
    is_one_slip,
    is_package_name,
)
from ..diagnostics.type_hints import any_of, missing_type_hint
from ..errors import DefinitionError
from .reading import KINDS, meant_path

_NOUNS = {"msg": "message", "srv": "service", "action": "action"}

Interfaces = Callable[[str], Iterable[str]]
"""Gives the full names of all that a package defines."""


def no_type(
    name: TypeName, packages: Mapping[str, Sequence[Path]], interfaces: Interfaces
) -> DefinitionError:
    """The error of a type that its package does not have; the hint names what was meant."""
    return DefinitionError(
        f"package {name.package!r} has no {_NOUNS[name.kind]} {name.name!r}",
        hint=_misnamed(name, packages[name.package]) or _meant(name, packages, interfaces),
    )


def no_package(
    package: str, packages: Iterable[str], roots: Iterable[Path], wanted: TypeName | None
) -> DefinitionError:
    """The error of a package that is nowhere, though perhaps its files are."""
    return DefinitionError(
        f"no package {package!r} within reach",
        hint=_stray(package, roots, wanted) or did_you_mean(package, packages),
    )


def name_hint(text: str, packages: Iterable[str], interfaces: Interfaces) -> str:
    """The full names of what a text that is no full type name may mean, or ""."""
    known = [one for package in packages for one in interfaces(package)]
    written = re.sub(r"\.(?:msg|srv|action)$", "", text)
    parts = [part for part in re.split(r"/|::|\.", written) if part]
    for resembles in (str.__eq__, is_one_slip):
        found = [one for one in known if parts and _is_meant(parts, one.split("/"), resembles)]
        if found:
            return any_of(found[:3])
    return ""


def _is_meant(parts: list[str], full: list[str], resembles: Callable[[str, str], bool]) -> bool:
    """Whether the last part resembles the full name's, and those before it stand there too."""
    is_like = resembles(parts[-1].lower(), full[-1].lower())
    return is_like and all(part in full for part in parts[:-1])


def _meant(name: TypeName, packages: Mapping[str, Sequence[Path]], interfaces: Interfaces) -> str:
    if name.kind == "msg" and (hint := missing_type_hint(name.name, [])):
        return hint
    known = [one.split("/") for one in interfaces(name.package)]
    own = [bare for _, kind, bare in known if kind == name.kind and is_message_name(bare)]
    if hint := did_you_mean(name.name, own):
        return hint
    for package, kind, bare in known:
        if bare == name.name:
            return f"did you mean {package}/{kind}/{bare}?"
    others = [one for package in packages for one in interfaces(package)]
    return missing_type_hint(name.name, _elsewhere(name, others))


def _elsewhere(name: TypeName, known: Iterable[str]) -> list[str]:
    """The types of other packages that have the name, else those that nearly have it."""
    wanted = name.name.lower()
    same = [(one.rpartition("/")[2].lower(), one) for one in known if f"/{name.kind}/" in one]
    found = [one for bare, one in same if bare == wanted]
    found = found or [one for bare, one in same if is_one_slip(bare, wanted)]
    return [one.replace("/msg/", "/") for one in found]


def _misnamed(name: TypeName, folders: Iterable[Path]) -> str:
    """A file of the package that would be the type if it had the right name."""
    right = f"{name.name}.{name.kind}"
    if not is_message_name(name.name):
        return ""
    for path in _files(folder / name.kind for folder in folders):
        meant = meant_path(path) or path
        if meant == path and is_message_name(path.stem):  # such as UInt8.msg for Uint8
            continue
        if path.name != right and meant.name.lower() == right.lower():
            return f"rename {name.kind}/{path.name} to {right}"
    return ""


def _stray(package: str, roots: Iterable[Path], wanted: TypeName | None) -> str:
    """A definition that lies beside the folder in which it should be."""
    if wanted and (stray := Path(f"{wanted.name}.{wanted.kind}")).is_file():
        return f"move {stray} to {package}/{wanted.kind}/{stray}"
    for path in _files(root / package for root in roots):
        kind = path.suffix.removeprefix(".")
        if kind in KINDS and is_package_name(package):
            return f"move {package}/{path.name} to {package}/{kind}/{path.name}"
    return ""


def _files(folders: Iterable[Path]) -> list[Path]:
    found: list[Path] = []
    for folder in folders:
        try:
            found += sorted(path for path in folder.iterdir() if path.is_file())
        except OSError:
            continue
    return found
