"""The folders of packages, by name."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

from srvgen.files import archive
from srvgen.files.search import BUNDLED
from taskrpc.ros import bundled, hook, workspace


def _no_folder(_: str) -> Path | None:
    return None


stand_in: Callable[[str], Path | None] = _no_folder
"""Returns the folder to use for a package that is not here, None to raise the error.

`taskrpc launch` sets it, so that a launch file starts what is here.
"""


class PackageNotFoundError(KeyError):
    """There is no package of this name."""


def get_package_share_path(package_name: str, print_warning: bool = True) -> Path:
    """The folder with a package's launch, configuration and other files: here its source folder.

    Raises PackageNotFoundError for an unknown package and ValueError for an invalid name.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-]+", package_name):
        raise ValueError(f"'{package_name}' is not a valid package name")
    folder = _packages().get(package_name)
    if folder is None and archive.definitions(package_name):
        return archive.unpacked(package_name)
    if folder is None:
        folder = stand_in(package_name)
    if folder is None:
        searched = [str(one) for one in _starts()]
        raise PackageNotFoundError(f"package '{package_name}' not found, searching: {searched}")
    return folder


def get_package_share_directory(package_name: str, print_warning: bool = True) -> str:
    """As `get_package_share_path`, but returns a string."""
    return str(get_package_share_path(package_name, print_warning))


def get_package_prefix(package_name: str) -> str:
    """The folder below which ROS installs the package; here its source folder.

    Raises the errors of `get_package_share_path`.
    """
    return get_package_share_directory(package_name)


def get_packages_with_prefixes() -> dict[str, str]:
    """All packages that are found, by name, each with its folder.

    Packages in srvgen's archive have a path below that of the archive.
    """
    packed = {name: archive.ARCHIVE / name for name in archive.packages()}
    return {name: str(folder) for name, folder in {**packed, **_packages()}.items()}


def _starts() -> list[Path]:
    script = getattr(sys.modules.get("__main__"), "__file__", None)
    return [*hook.starts(), *([Path(script).resolve().parent] if script else []), Path.cwd()]


def _packages() -> dict[str, Path]:
    found = workspace.packages(*_starts())
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            for manifest in Path(prefix).glob(f"share/*/{workspace.MANIFEST}"):
                found.setdefault(manifest.parent.name, manifest.parent)
    for name, folder in bundled.SHARES.items():
        found.setdefault(name, folder)
    for folder in BUNDLED.iterdir():
        found.setdefault(folder.name, folder)
    return found
