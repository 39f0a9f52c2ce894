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
_DEPTH = 4
"""Levels of folders, from a workspace's `src` on, in which packages are looked for."""

_DEPTH_ELSEWHERE = 2
"""The same where there is no `src`: the folder itself, and those in it."""

_MOST = 1_000
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
def _packages_in(top: Path) -> tuple[tuple[str, Path], ...]:
    found = []
    level = [top]
    looked_at = 0
    for _ in range(_DEPTH if top.name == "src" else _DEPTH_ELSEWHERE):
        below: list[Path] = []
        for folder in level[: _MOST - looked_at]:
            looked_at += 1
            if any((folder / name).exists() for name in _IGNORED):
                continue
            if (folder / MANIFEST).is_file():
                found.append((_name_of(folder), folder))
            else:
                below += _folders_in(folder)
        level = below
    return tuple(found)


def _folders_in(folder: Path) -> list[Path]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return []
    wanted = (one for one in entries if one.name not in _LEFT_OUT and not one.name.startswith("."))
    return [Path(entry.path) for entry in wanted if entry.is_dir(follow_symlinks=False)]


def _name_of(folder: Path) -> str:
    """The name in `package.xml`; the folder's where that cannot be read."""
    try:
        text = (folder / MANIFEST).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return folder.name
    found = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return found[1] if found else folder.name
