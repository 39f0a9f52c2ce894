"""The packages of a ROS workspace, found by `package.xml` in the sources, without a build."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

MANIFEST = "package.xml"
"""The file that marks a package. For a program's own package, `setup.py` is enough."""

_LEFT_OUT = {"build", "install", "log", "node_modules", "__pycache__"}
_IGNORED = ("COLCON_IGNORE", "AMENT_IGNORE")
_DEPTH_ELSEWHERE = 2
"""Levels that are searched outside `src`: a folder and its subfolders."""

_MOST = 5_000
"""Most folders to search: a large `src` in a home folder may not be a workspace."""


def package_of(path: Path) -> Path | None:
    """The folder of the package that contains a file or folder, or None."""
    for folder in (path, *path.parents):
        if (folder / MANIFEST).is_file() or (folder / "setup.py").is_file():
            return folder
    return None


def packages(*starts: Path) -> dict[str, Path]:
    """The packages around some files or folders, by name; earlier starts take precedence.

    For a file in a package, these are all packages in the `src` of the workspace. For a folder,
    these are the packages of the workspace that it is or contains.
    """
    found: dict[str, Path] = {}
    for start in starts:
        if (own := package_of(start)) is not None:
            found.setdefault(_name_of(own), own)
        for top in _tops(start):
            for name, folder in _packages_in(top):
                found.setdefault(name, folder)
    return found


def roots(*starts: Path) -> list[Path]:
    """Folders whose children are the packages around some files or folders."""
    tops = [top for start in starts for top in _tops(start)]
    return list(dict.fromkeys([*tops, *(folder.parent for folder in packages(*starts).values())]))


def _tops(start: Path) -> Iterator[Path]:
    """The folders in which the search for packages begins."""
    package = package_of(start)
    if package is not None:
        source = [folder for folder in package.parents if folder.name == "src"]
        yield source[0] if source else package.parent
    elif start.is_dir():
        if (start / "src").is_dir():
            yield start / "src"
        elif start.name == "src":
            yield start
        elif any(one.is_file() for one in start.glob(f"*/{MANIFEST}")):
            source = [folder for folder in start.parents if folder.name == "src"]
            yield source[0] if source else start


@cache  # called for every module that Python does not find
def _packages_in(given: Path) -> tuple[tuple[str, Path], ...]:
    """The packages below a folder, nearest first, as colcon finds them."""
    found = []
    top = given.resolve()
    level = [top]
    seen = {str(top)}
    depth = 0
    while level and (given.name == "src" or depth < _DEPTH_ELSEWHERE):
        below: list[Path] = []
        for folder in level:
            entries = _entries(folder)
            if any(name in entries for name in _IGNORED):
                continue
            if MANIFEST in entries:
                found.append((_name_of(folder), folder))
            else:
                below += _new_folders(entries, seen)
        level = below
        depth += 1
    return tuple(found)


def _entries(folder: Path) -> dict[str, os.DirEntry[str]]:
    try:
        with os.scandir(folder) as found:
            return {entry.name: entry for entry in found}
    except OSError:
        return {}


def _new_folders(entries: dict[str, os.DirEntry[str]], seen: set[str]) -> Iterator[Path]:
    """The subfolders that may contain packages; each folder of the disk once."""
    for name in sorted(entries):
        entry = entries[name]
        if name in _LEFT_OUT or name.startswith(".") or len(seen) >= _MOST or not entry.is_dir():
            continue
        # A link may lead to a folder above it, so real paths are compared.
        real = os.path.realpath(entry.path) if entry.is_symlink() else entry.path
        if real not in seen:
            seen.add(real)
            yield Path(real)


def _name_of(folder: Path) -> str:
    """The name in `package.xml`, or the folder's name if it cannot be read."""
    try:
        text = (folder / MANIFEST).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return folder.name
    found = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return found[1] if found else folder.name
