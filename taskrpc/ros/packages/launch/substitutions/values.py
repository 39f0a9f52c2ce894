"""Substitutions that look up a value: configurations, variables, the place of the launch file."""

from __future__ import annotations

import os
import random
import socket
from typing import Any

from ..launch_context import LaunchContext
from ..logging import launch_config
from ..some_substitutions_type import SomeSubstitutionsType
from ..substitution import (
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform,
    perform_substitutions,
)
from .texts import describe_all


class LaunchConfiguration(Substitution):
    """The value of a launch argument, or of another launch configuration."""

    def __init__(self, variable_name: SomeSubstitutionsType, *, default: Any = None) -> None:
        self._name = normalize_to_list_of_substitutions(variable_name)
        self._default = default

    @property
    def variable_name(self) -> list[Substitution]:
        """The name of the configuration."""
        return self._name

    def describe(self) -> str:
        """Describe the substitution."""
        return f"LaunchConfig({describe_all(self._name)})"

    def perform(self, context: LaunchContext) -> str:
        """Look the configuration up; raises SubstitutionFailure if it has no value."""
        name = perform_substitutions(context, self._name)
        context.used_configurations.add(name)
        value = context.launch_configurations.get(name)
        if value is not None:
            return str(value)
        if self._default is None:
            raise SubstitutionFailure(f"launch configuration '{name}' does not exist")
        if isinstance(self._default, (bool, int, float)):
            return str(self._default)
        return perform(context, self._default)


class EnvironmentVariable(Substitution):
    """The value of an environment variable."""

    def __init__(
        self,
        name: SomeSubstitutionsType,
        *,
        default_value: SomeSubstitutionsType | None = None,
    ) -> None:
        self._name = normalize_to_list_of_substitutions(name)
        self._default = default_value

    @property
    def name(self) -> list[Substitution]:
        """The name of the variable."""
        return self._name

    def describe(self) -> str:
        """Describe the substitution."""
        return f"EnvVar({describe_all(self._name)})"

    def perform(self, context: LaunchContext) -> str:
        """Look the variable up; raises SubstitutionFailure if it has no value."""
        name = perform_substitutions(context, self._name)
        value = context.environment.get(name)
        if value is not None:
            return value
        if self._default is None:
            raise SubstitutionFailure(f"environment variable '{name}' does not exist")
        return perform(context, self._default)


class LocalSubstitution(Substitution):
    """A value of the running event handler, such as `event.returncode`."""

    def __init__(self, expression: str, description: str | None = None) -> None:
        self._expression = expression
        self._description = description

    @property
    def expression(self) -> str:
        """The attributes behind `context.locals`."""
        return self._expression

    def describe(self) -> str:
        """Describe the substitution."""
        return f"LocalVar('{self._description or self._expression}')"

    def perform(self, context: LaunchContext) -> str:
        """Look the value up."""
        return str(eval(f"locals.{self._expression}", {}, {"locals": context.locals}))


class ThisLaunchFile(Substitution):
    """The path of the launch file that is executed."""

    def describe(self) -> str:
        """Describe the substitution."""
        return "ThisLaunchFile()"

    def perform(self, context: LaunchContext) -> str:
        """Return the path; raises SubstitutionFailure outside a launch file."""
        return _of_launch_file(context, "current_of_launch_file", "ThisLaunchFile")


class ThisLaunchFileDir(Substitution):
    """The folder of the launch file that is executed."""

    def describe(self) -> str:
        """Describe the substitution."""
        return "ThisLaunchFileDir()"

    def perform(self, context: LaunchContext) -> str:
        """Return the folder; raises SubstitutionFailure outside a launch file."""
        return _of_launch_file(context, "current_launch_file_directory", "ThisLaunchFileDir")


class LaunchLogDir(Substitution):
    """The folder of this launch's log files."""

    def describe(self) -> str:
        """Describe the substitution."""
        return "LaunchLogDir()"

    def perform(self, context: LaunchContext) -> str:
        """Return the folder."""
        return launch_config.log_dir


def _of_launch_file(context: LaunchContext, name: str, substitution: str) -> str:
    value = context.get_locals_as_dict().get(name)
    if value is None:
        raise SubstitutionFailure(f"{substitution} used outside of a launch file (in a script)")
    return str(value)


class AnonName(Substitution):
    """A name that no other launch uses; the same name for each use in this launch."""

    def __init__(self, name: SomeSubstitutionsType) -> None:
        self._name = normalize_to_list_of_substitutions(name)

    @property
    def name(self) -> list[Substitution]:
        """The beginning of the name."""
        return self._name

    def describe(self) -> str:
        """Describe the substitution."""
        return f"AnonName({describe_all(self._name)})"

    def perform(self, context: LaunchContext) -> str:
        """Return the name."""
        name = perform_substitutions(context, self._name)
        known = context.launch_configurations
        if f"anon{name}" not in known:
            host = socket.gethostname().replace(".", "_").replace("-", "_").replace(":", "_")
            known[f"anon{name}"] = f"{name}_{host}_{os.getpid()}_{random.randint(0, 2**31)}"
        return str(known[f"anon{name}"])
