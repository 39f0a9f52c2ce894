"""The action that executes another launch file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from taskrpc.ros.executables import missing_package
from taskrpc.ros.missing import explain_program

from ..action import Action
from ..launch_context import LaunchContext
from ..launch_description import LaunchDescription
from ..launch_description_entity import LaunchDescriptionEntity
from ..launch_description_source import LaunchDescriptionSource
from ..launch_description_sources import AnyLaunchDescriptionSource
from ..logging import warn_once
from ..substitution import perform, perform_substitutions
from .arguments import SetLaunchConfiguration
from .control import OpaqueFunction

_PATH, _FOLDER = "current_launch_file_path", "current_launch_file_directory"


class IncludeLaunchDescription(Action):
    """Executes another launch file.

    Args:
        launch_description_source: the launch file, or its path.
        launch_arguments: pairs of names and values.
    """

    def __init__(
        self,
        launch_description_source: Any,
        *,
        launch_arguments: Iterable[tuple[Any, Any]] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        if not isinstance(launch_description_source, LaunchDescriptionSource):
            launch_description_source = AnyLaunchDescriptionSource(launch_description_source)
        self._source: LaunchDescriptionSource = launch_description_source
        pairs = launch_arguments.items() if isinstance(launch_arguments, dict) else launch_arguments
        self._arguments = tuple(pairs or ())

    @property
    def launch_description_source(self) -> LaunchDescriptionSource:
        """The launch file."""
        return self._source

    @property
    def launch_arguments(self) -> tuple[tuple[Any, Any], ...]:
        """The pairs of names and values."""
        return self._arguments

    def describe(self) -> str:
        """Describe the action."""
        return f"IncludeLaunchDescription({self._source.location})"

    def get_sub_entities(self) -> list[Any]:
        """The launch description, if its path is known before the launch."""
        try:
            found = self._source.try_get_launch_description_without_context()
        except Exception:  # the file may not be used; its error is shown when it is executed
            return []
        return [] if found is None else [found]

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Load the launch file; returns what to execute, between new and old local values."""
        path = perform_substitutions(context, self._source.location_substitutions)
        if package := missing_package(path):
            warn_once(
                context,
                f"the launch file {os.path.basename(path)} of the package '{package}' is left out:"
                f" {explain_program(package) or 'taskrpc does not have this package'}",
            )
            return None
        description = self._source.get_launch_description(context)
        self._check_arguments(description, context)
        known = context.get_locals_as_dict()
        before = {name: known.get(name) for name in (_PATH, _FOLDER)}
        path = os.path.abspath(self._source.location)
        here = {_PATH: path, _FOLDER: os.path.dirname(path)}
        entities: list[LaunchDescriptionEntity] = [
            *(SetLaunchConfiguration(name, value) for name, value in self._arguments),
            OpaqueFunction(function=_extend, args=[here]),
            description,
            OpaqueFunction(function=_extend, args=[before]),
        ]
        return entities

    def _check_arguments(self, description: LaunchDescription, context: LaunchContext) -> None:
        given = [perform(context, name) for name, _ in self._arguments]
        for argument in description.get_launch_arguments():
            missing = argument.default_value is None and not argument.is_conditional
            if missing and argument.name not in {*given, *context.launch_configurations}:
                raise RuntimeError(
                    f"Included launch description missing required argument '{argument.name}'"
                    f" (description: '{argument.description}'), given: [{', '.join(given)}]"
                )


def _extend(context: LaunchContext, values: dict[str, Any]) -> None:
    context.extend_locals(values)
