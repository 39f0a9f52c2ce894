"""Reads packages of definitions in the archive `interfaces.zip`, without unpacking it.

The archive has one text for each package, made by `srvgen/public_interfaces/pack.py`: the texts of
all files, each after a line with its name. A file in it has a path below that of the archive, as if
the archive were a folder: `interfaces.zip/nav2_msgs/msg/Costmap.msg`.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from zipimport import ZipImportError, zipimporter  # far faster to import than zipfile

ARCHIVE = Path(__file__).parents[1] / "interfaces.zip"

_INSIDE = f"{ARCHIVE}{os.sep}"
_MARK = "=== "
"""The beginning of a line with the name of a file; no definition has such a line."""

_LIST = "packages.txt"


@cache
def packages() -> tuple[str, ...]:
    """The names of all packages in the archive, in order."""
    return tuple(_read(_LIST).split())


@cache
def definitions(package: str) -> Mapping[str, str]:
    """The texts of a package's files by name, such as `msg/Costmap.msg`; empty for no package."""
    found = {}
    for part in ("\n" + _read(f"{package}.txt")).split(f"\n{_MARK}")[1:]:
        name, _, text = part.partition("\n")
        found[name] = text if not text or text.endswith("\n") else f"{text}\n"
    return MappingProxyType(found)


def joined(texts: Mapping[str, str]) -> str:
    """The text of a package as the archive stores it; each is empty or ends with a line end."""
    return "".join(f"{_MARK}{name}\n{text}" for name, text in texts.items())


def file_of(path: Path) -> Path:
    """The file that has the text of a path: the archive for a path in it, otherwise the path."""
    return ARCHIVE if _is_inside(path) else path


def text_of(path: Path) -> str | None:
    """The text of a file in the archive; None for any other path."""
    if not _is_inside(path):
        return None
    package, *inner = path.relative_to(ARCHIVE).parts
    return definitions(package).get("/".join(inner))


def unpacked(package: str) -> Path:
    """A folder with the package's files, for what needs a real path; Python's end deletes it."""
    folder = _temporary_folder() / package
    for name, text in definitions(package).items():
        path = folder / name
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="")
    return folder


def package_of(path: str) -> str:
    """The package in whose `unpacked` folder a path is; "" for any other path."""
    if not _temporary_folder.cache_info().currsize:
        return ""  # nothing is unpacked
    folder, parts = _temporary_folder().parts, Path(path).parts
    return parts[len(folder)] if parts[: len(folder)] == folder and parts != folder else ""


@cache
def _temporary_folder() -> Path:
    from tempfile import TemporaryDirectory  # only few programs need it

    folder = TemporaryDirectory(prefix="srvgen-")
    atexit.register(folder.cleanup)
    return Path(folder.name)


def _is_inside(path: Path) -> bool:
    return str(path).startswith(_INSIDE)  # `in path.parents` would make an object of each


def _read(name: str) -> str:
    try:
        return zipimporter(str(ARCHIVE)).get_data(name).decode("utf-8")
    except (OSError, ZipImportError):  # no such file in the archive, or no archive
        return ""
