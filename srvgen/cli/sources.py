"""Finds the definition files that the arguments `SRC...` of `srvgen` commands mean."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ..definitions.names import did_you_mean
from ..errors import DefinitionError
from ..files.reading import KINDS, has_subfolders, kind_folder, kind_of, subfolders
from ..files.search import Search

_SKIPPED_FOLDERS = ("build", "install", "log", "node_modules", "__pycache__")
"""Folders below `src` that do not contain packages."""


def is_type_name(source: str) -> bool:
    """Whether a source is the name of a type, and not a file or a folder."""
    return re.fullmatch(r"\w+/(?:\w+/)?\w+", source) is not None and not Path(source).exists()


def files_of(source: str, search: Search) -> list[Path]:
    """The definition files that a source means, in a fixed order.

    A source is a file, a package folder, a folder of packages or a workspace with `src`, or the
    name of a type or a package. Files with a misspelt extension (`X.srv.txt`) are included, so
    that they are reported.

    Raises:
        DefinitionError: the source does not exist or contains no definition.
    """
    if is_type_name(source):
        return [search.find(source)]
    path = Path(source)
    if _exists(path):
        return definition_files(path)
    if search.has_package(source):
        return [search.find(name) for name in search.interfaces(source)]
    raise DefinitionError(
        "expected a file, a folder or the name of a type, got a path that does not exist",
        path=source,
        hint=did_you_mean(path.name, _choices(path.parent))
        or did_you_mean(source, search.packages()),
    )


def _choices(folder: Path) -> list[str]:
    """The names in a folder that a misspelt path may mean."""
    try:
        return [
            one.name
            for one in folder.iterdir()
            if one.is_file() or (one.is_dir() and one.suffix.removeprefix(".") not in KINDS)
        ]
    except OSError:
        return []


def _exists(path: Path) -> bool:
    try:
        path.stat()
    except FileNotFoundError:
        return False
    except OSError as error:
        raise DefinitionError(
            f"expected a file or folder, got: {error.strerror or error}", path=str(path)
        ) from None
    return True


def definition_files(source: Path) -> list[Path]:
    """The definition files that an existing file or folder means.

    Raises:
        DefinitionError: the folder contains no definition or cannot be read.
    """
    if not source.is_dir():
        return [source]
    try:
        found = _in_packages(source) or _in_folder(source)
    except OSError as error:
        raise DefinitionError(
            f"expected a readable folder, got: {error.strerror or error}", path=str(source)
        ) from None
    if found:
        return found
    raise DefinitionError(
        "expected definitions (.msg, .srv, .action), got a folder without any",
        path=str(source),
        hint="put them into the folders msg, srv and action of a package",
    )


def search_paths(sources: Sequence[str]) -> list[Path]:
    """The folders that contain the packages of the sources and their neighbours."""
    found: dict[Path, None] = {}
    for source in sources:
        try:
            folder = Path(source).resolve(strict=True)
        except (OSError, RuntimeError):  # a type name, or an error that reading it reports
            continue
        if folder.is_file():
            folder = folder.parent
        if (kind := kind_folder(folder / "any file")) is not None:
            folder = kind.parent
        found[folder] = None
        if any((folder / kind).is_dir() for kind in KINDS):
            found[folder.parent] = None
        below = _below(folder if folder.name == "src" else folder / "src")
        with suppress(OSError):  # unreadable files are reported when they are read
            found |= dict.fromkeys(each.parent for each in below if _in_package(each))
    return list(found)


def _in_packages(source: Path) -> list[Path]:
    """The files of the source as a package, else of the packages in it, else of those below `src`.

    Below `src` packages may be at any depth, otherwise directly in the source.
    """
    for folders in (
        [source],
        _below(source) if source.name == "src" else sorted(source.iterdir()),
        _below(source / "src"),
    ):
        found = [path for folder in folders if folder.is_dir() for path in _in_package(folder)]
        if found:
            return found
    return []


def _below(source: Path) -> Iterator[Path]:
    """The folders below `src` that may be packages, without folders inside packages."""
    if (source / "COLCON_IGNORE").exists() or not source.is_dir():
        return
    for folder in sorted(each for each in source.iterdir() if each.is_dir()):
        if folder.name.startswith(".") or folder.name in _SKIPPED_FOLDERS or folder.is_symlink():
            continue
        yield folder
        if not (folder / "package.xml").is_file() and not _in_package(folder):
            yield from _below(folder)


def _in_package(folder: Path) -> list[Path]:
    found = []
    for inner in (folder / kind for kind in KINDS if (folder / kind).is_dir()):
        found += _in_folder(inner)
        for below in subfolders(inner) if has_subfolders(folder) else ():
            found += _in_folder(below)
    return found


def _in_folder(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.iterdir()) if _is_meant(path)]


def _is_meant(path: Path) -> bool:
    """Whether a file is a definition or has a misspelt extension of one."""
    try:
        kind_of(path)
    except DefinitionError as error:
        return bool(error.hint) and path.is_file()
    # Folders and broken links with such a name are included: reading them reports the error.
    return not path.name.startswith(".")
