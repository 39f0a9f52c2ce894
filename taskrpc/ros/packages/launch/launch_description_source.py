"""Where a launch description comes from: an object, or a launch file."""

from __future__ import annotations

import os
from typing import Any

from .launch_context import LaunchContext
from .launch_description import LaunchDescription
from .some_substitutions_type import SomeSubstitutionsType
from .substitution import (
    Substitution,
    TextSubstitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)


class InvalidLaunchFileError(Exception):
    """A launch file has no known form, or it contains an error."""


class LaunchDescriptionSource:
    """A launch description, or the path of a launch file that returns one.

    Args:
        launch_description: the description, None for that of the file.
        location: the path of the file.
        method: how the description is made, for messages.
    """

    def __init__(
        self,
        launch_description: LaunchDescription | None = None,
        location: SomeSubstitutionsType = "",
        method: str = "unspecified mechanism from a script",
    ) -> None:
        self._description = launch_description
        self._location = normalize_to_list_of_substitutions(location)
        self._path: str | None = None
        self._method = method

    @property
    def location(self) -> str:
        """The path of the file, or its substitutions as long as they are not computed."""
        if self._path is None:
            return " + ".join(each.describe() for each in self._location)
        return self._path

    @property
    def method(self) -> str:
        """How the description is made."""
        return self._method

    def get_launch_description(self, context: LaunchContext) -> LaunchDescription:
        """Load the launch file if this is not done yet; returns its description."""
        path = os.path.expanduser(perform_substitutions(context, self._location))
        if self._description is None or self._path != path:
            self._path = path
            if self._description is None or path:
                self._description = self._get_launch_description(path)
        return self._description

    def try_get_launch_description_without_context(self) -> LaunchDescription | None:
        """The description, None if its path is not known before the launch file is executed."""
        if self._description is None and all(
            isinstance(each, TextSubstitution) for each in self._location
        ):
            return self.get_launch_description(LaunchContext())
        return self._description

    def _get_launch_description(self, location: str) -> LaunchDescription:
        """Load a launch file; subclasses know how."""
        raise NotImplementedError(f"{type(self).__name__} cannot load {location}")

    @property
    def location_substitutions(self) -> list[Substitution]:
        """The substitutions of the path."""
        return self._location


def checked_file(location: str) -> str:
    """Return the path of a launch file; raises FileNotFoundError if there is none."""
    if not os.path.isfile(location):
        raise FileNotFoundError(f"[Errno 2] No such file or directory: '{location}'")
    return location


def checked_description(value: Any, location: str) -> LaunchDescription:
    """Return what a launch file returns; raises RuntimeError if it is no launch description."""
    if not isinstance(value, LaunchDescription):
        raise RuntimeError(
            f"launch file at '{location}': expected generate_launch_description() to return a"
            f" LaunchDescription, got {type(value).__name__}"
        )
    return value
