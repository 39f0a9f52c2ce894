"""Makes `import rclpy` load our layer, and interface packages load from their definitions."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

import srvgen

_FOLDER = Path(__file__).resolve().parent.parent / "rclpy"


def install(*folders: Path | str) -> None:
    """Let this process import `rclpy` and interface packages from now on.

    Args:
        folders: where to look for packages of definitions first, such as the script's own folder.
    """
    srvgen.install_import_hook(*folders)
    if _finder not in sys.meta_path:
        # In front: whoever asks for it here wants ours, also beside a folder named `rclpy`.
        sys.meta_path.insert(0, _finder)


def uninstall() -> None:
    """Take the hook away again, with the modules that came with it."""
    srvgen.importer.uninstall_import_hook()
    if _finder in sys.meta_path:
        sys.meta_path.remove(_finder)
    for name in [one for one in sys.modules if one.partition(".")[0] == "rclpy"]:
        del sys.modules[name]


def real_rclpy() -> str:
    """Where a real rclpy lies that this Python could import, "" where there is none."""
    spec = PathFinder.find_spec("rclpy")
    return "" if spec is None or spec.origin is None else spec.origin


class _RclpyFinder(MetaPathFinder):
    """Finds the package `rclpy`; its modules Python finds itself, in the package's folder."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "rclpy":
            return None
        return spec_from_file_location(
            "rclpy", _FOLDER / "__init__.py", submodule_search_locations=[str(_FOLDER)]
        )


_finder = _RclpyFinder()
