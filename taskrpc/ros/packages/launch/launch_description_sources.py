"""Launch files in Python, XML and YAML."""

from __future__ import annotations

import importlib
import os
import runpy
from pathlib import Path
from typing import Any

from taskrpc.ros import hook
from taskrpc.ros.module_names import add_module_names

from .launch_description import LaunchDescription
from .launch_description_source import (
    InvalidLaunchFileError,
    LaunchDescriptionSource,
    checked_description,
    checked_file,
)
from .some_substitutions_type import SomeSubstitutionsType

_FRONT_ENDS = {".xml": "launch_xml", ".yaml": "launch_yaml", ".yml": "launch_yaml"}
_FUNCTION = "generate_launch_description"


class InvalidPythonLaunchFileError(InvalidLaunchFileError):
    """A Python launch file does not have the function that every launch file has."""


class InvalidFrontendLaunchFileError(InvalidLaunchFileError):
    """An XML or YAML launch file contains an error."""


class PythonLaunchDescriptionSource(LaunchDescriptionSource):
    """A launch file in Python."""

    def __init__(self, launch_file_path: SomeSubstitutionsType) -> None:
        super().__init__(None, launch_file_path, "interpreted python launch file")

    def _get_launch_description(self, location: str) -> LaunchDescription:
        return get_launch_description_from_python_launch_file(location)


class FrontendLaunchDescriptionSource(LaunchDescriptionSource):
    """A launch file in XML or YAML; its suffix tells which."""

    def __init__(
        self,
        launch_file_path: SomeSubstitutionsType,
        *,
        parser: Any = None,
        method: str = "interpreted frontend launch file",
    ) -> None:
        super().__init__(None, launch_file_path, method)
        self._parser = parser

    def _get_launch_description(self, location: str) -> LaunchDescription:
        return get_launch_description_from_frontend_launch_file(location, parser=self._parser)


class AnyLaunchDescriptionSource(LaunchDescriptionSource):
    """A launch file in Python, XML or YAML; its suffix tells which."""

    def __init__(self, launch_file_path: SomeSubstitutionsType) -> None:
        super().__init__(None, launch_file_path, "interpreted launch file")

    def _get_launch_description(self, location: str) -> LaunchDescription:
        return get_launch_description_from_any_launch_file(location)


def get_launch_description_from_python_launch_file(location: str) -> LaunchDescription:
    """Execute a Python launch file; returns its description."""
    path = checked_file(location)
    # Its package's modules are importable, as after `colcon build`.
    hook.install(Path(path).resolve().parent)
    # The module gets the name that it has in ROS. With the name of a file launch.py, Python would
    # take the file for the package `launch` that it imports.
    names = runpy.run_path(path, run_name="python_launch_file")
    function = names.get(_FUNCTION)
    if function is None:
        raise InvalidPythonLaunchFileError(
            f"launch file at '{location}' does not contain the required function '{_FUNCTION}()';"
            " define it, and return a LaunchDescription"
        )
    return checked_description(function(), location)


def get_launch_description_from_frontend_launch_file(
    location: str, *, parser: Any = None
) -> LaunchDescription:
    """Read an XML or YAML launch file; returns its description."""
    path = checked_file(location)
    if parser is None:
        suffix = os.path.splitext(path)[1]
        if suffix not in _FRONT_ENDS:
            raise InvalidLaunchFileError(
                f"The launch file '{location}' may have a syntax error, or its format is unknown:"
                " expected a name that ends in .py, .xml, .yaml or .yml"
            )
        parser = importlib.import_module(f"{_FRONT_ENDS[suffix]}.parser").Parser
    root, found = parser.load(path)
    description = found.parse_description(root)
    if not isinstance(description, LaunchDescription):
        raise InvalidFrontendLaunchFileError(f"launch file at '{location}': expected <launch>")
    return description


def get_launch_description_from_any_launch_file(location: str) -> LaunchDescription:
    """Load a launch file of any kind; returns its description."""
    if location.endswith(".py"):
        return get_launch_description_from_python_launch_file(location)
    return get_launch_description_from_frontend_launch_file(location)


__all__ = [
    "AnyLaunchDescriptionSource",
    "FrontendLaunchDescriptionSource",
    "InvalidFrontendLaunchFileError",
    "InvalidPythonLaunchFileError",
    "PythonLaunchDescriptionSource",
    "get_launch_description_from_any_launch_file",
    "get_launch_description_from_frontend_launch_file",
    "get_launch_description_from_python_launch_file",
]

add_module_names(__name__)
