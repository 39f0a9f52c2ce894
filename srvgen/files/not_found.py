"""The errors of a type or a package that cannot be found, with suggestions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from ..definitions.names import (
    TypeName,
    did_you_mean,
    is_message_name,
    is_one_typo,
    is_package_name,
    similar_names,
)
from ..diagnostics.type_hints import missing_type_hint, suggest
from ..errors import DefinitionError
from .archive import ARCHIVE
from .reading import KINDS, meant_path

_NOUNS = {"msg": "message", "srv": "service", "action": "action"}

Interfaces = Callable[[str], Iterable[str]]
"""Returns the full names of all interfaces of a package."""


def unknown_type(
    name: TypeName, packages: Mapping[str, Sequence[Path]], interfaces: Interfaces
) -> DefinitionError:
    """The error of a type that its package does not have."""
    return DefinitionError(
        f"package {name.package!r} has no {_NOUNS[name.kind]} {name.name!r}",
        hint=_misnamed_file(name, packages[name.package])
        or _suggestion(name, packages, interfaces),
    )


def unknown_package(
    package: str,
    packages: Mapping[str, Sequence[Path]],
    roots: Iterable[Path],
    wanted: TypeName | None,
) -> DefinitionError:
    """The error of a package that cannot be found; the hint may say where its files are."""
    return DefinitionError(
        f"package {package!r} not found",
        hint=_misplaced_file(package, roots, wanted)
        or next(filter(None, (_package_hint(package, each) for each in _groups(packages))), ""),
    )


def _package_hint(package: str, known: Iterable[str]) -> str:
    """A hint with the packages that `package` resembles, even without a common `_msgs`, or ""."""
    stem, _, word = package.rpartition("_")
    ending = f"_{word}"
    stems = [(one.removesuffix(ending), one) for one in known]
    alike = [
        one
        for bare, one in stems
        if bare == one or is_one_typo(bare, stem) or similar_names(stem, [bare])
    ]
    return did_you_mean(package, alike)


def name_hint(text: str, packages: Mapping[str, Sequence[Path]], interfaces: Interfaces) -> str:
    """A hint with the full type names that an invalid type name may mean, or ""."""
    written = re.sub(r"\.(?:msg|srv|action)$", "", text)
    parts = [part for part in re.split(r"/|::|\.", written) if part]
    for group in _groups(packages) if parts else ():
        known = [one for package in group for one in interfaces(package)]
        for resembles in (str.__eq__, is_one_typo):
            if found := [one for one in known if _is_meant(parts, one.split("/"), resembles)]:
                return suggest(found[:3])
    return ""


def _groups(packages: Mapping[str, Sequence[Path]]) -> Iterator[list[str]]:
    """The names of packages, those in the archive last: they are rarely meant."""
    packed = [name for name, folders in packages.items() if folders[0].parent == ARCHIVE]
    yield [name for name in packages if name not in packed]
    yield packed


def _is_meant(parts: list[str], full: list[str], resembles: Callable[[str, str], bool]) -> bool:
    """Whether the last parts are similar, and the full name has the other parts too."""
    is_like = resembles(parts[-1].lower(), full[-1].lower())
    return is_like and all(part in full for part in parts[:-1])


def _suggestion(
    name: TypeName, packages: Mapping[str, Sequence[Path]], interfaces: Interfaces
) -> str:
    if name.kind == "msg" and (hint := missing_type_hint(name.name, [])):
        return hint
    known = [one.split("/") for one in interfaces(name.package)]
    own = [bare for _, kind, bare in known if kind == name.kind and is_message_name(bare)]
    if hint := did_you_mean(name.name, own):
        return hint
    for package, kind, bare in known:
        if bare == name.name:
            return f"did you mean {package}/{kind}/{bare}?"
    for group in _groups(packages):
        others = [one for package in group for one in interfaces(package)]
        if hint := missing_type_hint(name.name, _elsewhere(name, others)):
            return hint
    return ""


def _elsewhere(name: TypeName, known: Iterable[str]) -> list[str]:
    """The types of other packages with the same name, else with a similar one."""
    wanted = name.name.lower()
    same = [(one.rpartition("/")[2].lower(), one) for one in known if f"/{name.kind}/" in one]
    found = [one for bare, one in same if bare == wanted]
    found = found or [one for bare, one in same if is_one_typo(bare, wanted)]
    return [one.replace("/msg/", "/") for one in found]


def _misnamed_file(name: TypeName, folders: Iterable[Path]) -> str:
    """A hint to rename a file of the package that would then define the type, or ""."""
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


def _misplaced_file(package: str, roots: Iterable[Path], wanted: TypeName | None) -> str:
    """A hint to move a definition file to its correct folder, or ""."""
    if wanted and (misplaced := Path(f"{wanted.name}.{wanted.kind}")).is_file():
        return f"move {misplaced} to {package}/{wanted.kind}/{misplaced}"
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
