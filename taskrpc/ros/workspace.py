"""Packages of a ROS workspace as their sources lie there: `package.xml`, not built or installed."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

MANIFEST = "package.xml"
"""The file that makes a folder a package; for a program's own, `setup.py` does, too."""

_LEFT_OUT = {"build", "install", "log", "node_modules", "__pycache__"}
_IGNORED = ("COLCON_IGNORE", "AMENT_IGNORE")
_DEPTH_ELSEWHERE = 2
"""Levels of folders in which packages are looked for outside `src`: a folder, and those in it."""

_MOST = 5_000
"""Folders that are looked into: a home folder's `src` is no workspace, and may be large."""


def package_of(path: Path) -> Path | None:
    """The package that a file or folder belongs to."""
    for folder in (path, *path.parents):
        if (folder / MANIFEST).is_file() or (folder / "setup.py").is_file():
            return folder
    return None


def packages(*starts: Path) -> dict[str, Path]:
    """The packages around some files or folders by their names, the first ones' before others'.

    Those are the neighbours of the package that a file is in, up to its workspace's `src`, and
    what lies in a folder that is or has a workspace.
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
    """Where to look for packages from."""
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


@cache  # a program asks for every module that it cannot import
def _packages_in(given: Path) -> tuple[tuple[str, Path], ...]:
    """The packages below a folder, in order of depth; as colcon finds them."""
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
    """The folders among the entries in which packages may lie, each folder of the disk once."""
    for name in sorted(entries):
        entry = entries[name]
        if name in _LEFT_OUT or name.startswith(".") or len(seen) >= _MOST or not entry.is_dir():
            continue
        # A link may lead to a folder that contains it, so compare the real folders.
        real = os.path.realpath(entry.path) if entry.is_symlink() else entry.path
        if real not in seen:
            seen.add(real)
            yield Path(real)


def _name_of(folder: Path) -> str:
    """The name in `package.xml`; the folder's where that cannot be read."""
    try:
        text = (folder / MANIFEST).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return folder.name
    found = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return found[1] if found else folder.name
