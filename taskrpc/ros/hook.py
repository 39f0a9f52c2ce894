"""The import hook: `import rclpy` loads `packages/rclpy`, interface packages their definitions."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import srvgen
from srvgen.classes.loader import make_ros_classes
from taskrpc.ros import bundled, workspace
from taskrpc.ros.missing import ExplainingFinder, explain_ros, explain_ros_or_interfaces

if TYPE_CHECKING:
    from importlib.abc import MetaPathFinder
else:  # slow to import, and not needed
    MetaPathFinder = object

_WATCHER = "_taskrpc_ros"
"""The module that an enabled environment imports at its start: a copy of `start.py`."""


def install(*folders: Path | str) -> None:
    """Let this process import `rclpy` and interface packages from now on.

    Args:
        folders: folders to search first for packages of definitions, such as the script's folder.
            If one is in a workspace, the workspace's packages are found as well.
    """
    if (watcher := sys.modules.get(_WATCHER)) is not None:
        vars(watcher)["_over"] = True  # otherwise the watcher handles the same imports
    make_ros_classes()
    starts = [Path(folder).resolve() for folder in folders]
    srvgen.install_import_hook(*starts, *workspace.roots(*starts))
    _workspace.starts = list(dict.fromkeys([*starts, *_workspace.starts]))
    if _finder not in sys.meta_path:
        # In front, so that this rclpy is found even beside a folder named `rclpy`.
        sys.meta_path.insert(0, _finder)
        # Behind Python's own finder, and before srvgen's, which suggests similar names.
        sys.meta_path[_behind_python() : _behind_python()] = [_workspace, _explaining_ros]
        sys.meta_path.append(_explaining_interfaces)


def real_rclpy() -> str:
    """The path of a real rclpy that this Python can import, or "" if there is none."""
    spec = PathFinder.find_spec("rclpy")
    return "" if spec is None or spec.origin is None else spec.origin


def starts() -> list[Path]:
    """The folders that the hook was installed for."""
    return list(_workspace.starts)


def _behind_python() -> int:
    finders = sys.meta_path
    return finders.index(PathFinder) + 1 if PathFinder in finders else len(finders)


def _package(name: str, folder: Path) -> ModuleSpec | None:
    return spec_from_file_location(
        name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )


class _RosNamesFinder(MetaPathFinder):
    """Finds the packages with ROS names; Python then finds their modules in the folders."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        folder = bundled.packages().get(fullname)
        if folder is None:
            return None
        if fullname == "rclpy":
            return _package(fullname, folder)
        # A real package takes precedence, but not a folder without code, such as that of the
        # launch files: Python prefers any package to it as well.
        real = PathFinder.find_spec(fullname)
        if real is not None and real.origin is not None:
            return None
        return _package(fullname, folder)


class _WorkspaceFinder(MetaPathFinder):
    """Finds the Python modules of the workspace's packages, which ROS installs."""

    def __init__(self) -> None:
        self.starts: list[Path] = []
        self._found: set[str] = set()
        """The top-level packages that this finder has found; only their submodules are searched."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        top, _, inner = fullname.partition(".")
        if inner and top not in self._found:
            return None
        packages = workspace.packages(*self.starts)
        # The package with this name first: most packages are named like their module.
        own = [(top, packages[top])] if top in packages else []
        for name, folder in [*own, *packages.items()]:
            known = _modules_of(folder, name)
            found = known.get(fullname)
            if found is None and not any(each.startswith(f"{fullname}.") for each in known):
                continue
            self._found.add(top)
            return _spec(fullname, found)
        return None


@cache  # called for every module that Python does not find
def _modules_of(package: Path, name: str) -> dict[str, Path]:
    from taskrpc.ros.installed import modules

    return modules(package, name)


def _spec(name: str, path: Path | None) -> ModuleSpec | None:
    """The spec of a module in a file or folder; for None, of a package without a folder."""
    if path is None:
        return ModuleSpec(name, None, is_package=True)
    if path.name == "__init__.py":
        return _package(name, path.parent)
    if path.is_file():
        return spec_from_file_location(name, path)
    if (path / "__init__.py").is_file():
        return _package(name, path)
    spec = ModuleSpec(name, None, is_package=True)
    spec.submodule_search_locations = [str(path)]
    return spec


_finder = _RosNamesFinder()
_workspace = _WorkspaceFinder()
_explaining_ros = ExplainingFinder(explain_ros)
_explaining_interfaces = ExplainingFinder(explain_ros_or_interfaces)
