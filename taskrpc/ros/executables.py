"""Decides how a package's executable is started here, or why it cannot be."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from srvgen.definitions.names import similar_names
from srvgen.files import archive
from taskrpc.errors import TaskRpcError
from taskrpc.ros import bundled, cmake, installed, workspace
from taskrpc.ros.missing import WHAT_RUNS, explain_program

_MISSING = "taskrpc-does-not-have"


class NotHere(TaskRpcError):
    """The executable needs a real ROS 2."""


def missing_folder(package: str) -> Path:
    """The folder that stands for a package that is not here; it does not exist."""
    return Path(tempfile.gettempdir(), _MISSING, package)


def missing_package(path: str) -> str:
    """The package that a path belongs to, if taskrpc has at most its definitions, else ""."""
    parts = Path(path).parts
    if _MISSING in parts[:-1]:
        return parts[parts.index(_MISSING) + 1]
    return "" if os.path.exists(path) else archive.package_of(path)


def run_arguments(package: str, executable: str, starts: Sequence[Path]) -> list[str]:
    """The arguments of `taskrpc run` that start an executable.

    Args:
        starts: the folders whose workspaces are searched besides the working directory's.

    Raises NotHere for a program that only a real ROS 2 has, and TaskRpcError for a wrong name.
    """
    here = workspace.packages(Path.cwd())
    packages = {**workspace.packages(*starts), **here}
    folder = packages.get(package)
    if folder is not None:
        _check_executable(package, folder, executable)
        option = [] if package in here else ["--workspace", str(folder)]
        return [*option, package, executable]
    if executable in bundled.EXECUTABLES.get(package, ()):
        return [package, executable]
    missing = NotHere(f"taskrpc does not have '{executable}' of the package '{package}'")
    if package in bundled.EXECUTABLES:
        raise missing
    if advice := explain_program(package):
        missing.add_note(advice)
        raise missing
    if guesses := similar_names(package, {*packages, *bundled.EXECUTABLES}):
        raise TaskRpcError(f"package '{package}' not found; did you mean {' or '.join(guesses)}?")
    raise missing


def _check_executable(package: str, folder: Path, executable: str) -> None:
    names = installed.executables(folder)
    if executable in names or installed.script(folder, executable) is not None:
        return
    if executable in compiled_programs(folder):
        compiled = NotHere(f"'{executable}' of the package '{package}' is a compiled program")
        compiled.add_note(WHAT_RUNS)
        raise compiled
    has = ", ".join(sorted(names)) or "no executables"
    raise TaskRpcError(
        f"executable '{executable}' not found in the package '{package}' at '{folder}';"
        f" it has {has}"
    )


def compiled_programs(folder: Path) -> set[str]:
    """The programs that CMake compiles in the package of this folder; they do not run here."""
    found = set()
    for command, arguments in cmake.commands(folder):
        if command in ("add_executable", "ament_auto_add_executable") and arguments:
            found.add(arguments[0])
        elif command == "rclcpp_components_register_node":
            found |= {arguments[n + 1] for n, x in enumerate(arguments[:-1]) if x == "EXECUTABLE"}
    return found
