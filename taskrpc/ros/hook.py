"""Makes `import rclpy` load our layer, and interface packages load from their definitions."""

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
from taskrpc.ros import workspace
from taskrpc.ros.absent import AbsentFinder, of_ros, of_ros_or_interfaces

if TYPE_CHECKING:
    from importlib.abc import MetaPathFinder
else:  # slow to import, and not needed
    MetaPathFinder = object

_OURS = Path(__file__).resolve().parent.parent
_HOMES = {
    "rclpy": _OURS / "rclpy",
    "ament_index_python": _OURS / "ros" / "ament_index_python",
    "rosidl_parser": _OURS / "ros" / "rosidl_parser",
    "rosidl_runtime_py": _OURS / "ros" / "rosidl_runtime_py",
}
"""What is imported under ROS's names, and where it lies; real ones go before, but for rclpy."""

_WATCHER = "_taskrpc_ros"
"""What an enabled environment imports at its start (`start.py` under a name of its own)."""


def install(*folders: Path | str) -> None:
    """Let this process import `rclpy` and interface packages from now on.

    Args:
        folders: where to look for packages of definitions first, such as the script's own folder;
            where it is in a workspace, the packages of that are found, too.
    """
    if (watcher := sys.modules.get(_WATCHER)) is not None:
        vars(watcher)["_over"] = True  # it would find our module and take it for another package
    make_ros_classes()
    starts = [Path(folder).resolve() for folder in folders]
    srvgen.install_import_hook(*starts, *workspace.roots(*starts))
    _neighbours.starts = list(dict.fromkeys([*starts, *_neighbours.starts]))
    if _finder not in sys.meta_path:
        # In front, so that our rclpy is found even beside a folder named `rclpy`.
        sys.meta_path.insert(0, _finder)
        # Behind Python's own, before the one that guesses what was misspelt.
        sys.meta_path[_behind_python() : _behind_python()] = [_neighbours, _absent]
        sys.meta_path.append(_nowhere)


def real_rclpy() -> str:
    """Where a real rclpy lies that this Python could import, "" where there is none."""
    spec = PathFinder.find_spec("rclpy")
    return "" if spec is None or spec.origin is None else spec.origin


def starts() -> list[Path]:
    """The folders that the hook was installed for."""
    return list(_neighbours.starts)


def _behind_python() -> int:
    finders = sys.meta_path
    return finders.index(PathFinder) + 1 if PathFinder in finders else len(finders)


def _package(name: str, folder: Path) -> ModuleSpec | None:
    return spec_from_file_location(
        name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )


class _OurFinder(MetaPathFinder):
    """Finds our packages; their modules Python finds itself, in the package's folder."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in _HOMES or (fullname != "rclpy" and PathFinder.find_spec(fullname)):
            return None
        return _package(fullname, _HOMES[fullname])


class _NeighbourFinder(MetaPathFinder):
    """Finds Python modules of the workspace, which ROS would have installed."""

    def __init__(self) -> None:
        self.starts: list[Path] = []
        self._found: set[str] = set()
        """Packages whose modules may lie outside of their own folder."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        top, _, inner = fullname.partition(".")
        if inner and top not in self._found:
            return None
        packages = workspace.packages(*self.starts)
        # The package of this name first: most are called like their module.
        own = [(top, packages[top])] if top in packages else []
        for name, folder in [*own, *packages.items()]:
            known = _modules_of(folder, name)
            place = known.get(fullname)
            if place is None and not any(each.startswith(f"{fullname}.") for each in known):
                continue
            self._found.add(top)
            return _spec(fullname, place)
        return None


@cache  # called for every module that a program cannot import
def _modules_of(package: Path, name: str) -> dict[str, Path]:
    from taskrpc.ros.executables import modules

    return modules(package, name)


def _spec(name: str, place: Path | None) -> ModuleSpec | None:
    """The spec of a module that is a file or a folder; of a package without a folder for None."""
    if place is None:
        return ModuleSpec(name, None, is_package=True)
    if place.name == "__init__.py":
        return _package(name, place.parent)
    if place.is_file():
        return spec_from_file_location(name, place)
    if (place / "__init__.py").is_file():
        return _package(name, place)
    spec = ModuleSpec(name, None, is_package=True)
    spec.submodule_search_locations = [str(place)]
    return spec


_finder = _OurFinder()
_neighbours = _NeighbourFinder()
_absent = AbsentFinder(of_ros)
_nowhere = AbsentFinder(of_ros_or_interfaces)
