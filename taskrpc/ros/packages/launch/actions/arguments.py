"""Actions for launch arguments, configurations and environment variables."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from ..action import Action
from ..launch_context import LaunchContext, replace_environment
from ..some_substitutions_type import SomeSubstitutionsType
from ..substitution import (
    Substitution,
    normalize_to_list_of_substitutions,
    perform,
    perform_substitutions,
)


class DeclareLaunchArgument(Action):
    """Declares an argument of the launch file, with its default and its allowed values."""

    declares_argument = True

    def __init__(
        self,
        name: str,
        *,
        default_value: SomeSubstitutionsType | None = None,
        description: str | None = None,
        choices: Iterable[str] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._name = name
        self._default = (
            None if default_value is None else normalize_to_list_of_substitutions(default_value)
        )
        self._choices = None if choices is None else list(choices)
        if self._choices == []:
            raise ValueError(f"expected at least one value in choices of the argument '{name}'")
        self._description = description or "no description given"
        if self._choices:
            self._description = f"{description}. " if description else ""
            self._description += f"Valid choices are: {self._choices}"
        self.is_conditional = False
        """Whether a condition decides if it is declared; set by `get_launch_arguments`."""

    @property
    def name(self) -> str:
        """The argument's name."""
        return self._name

    @property
    def default_value(self) -> list[Substitution] | None:
        """The value if none is given, None if one is required."""
        return self._default

    @property
    def description(self) -> str:
        """What the argument is for."""
        return self._description

    @property
    def choices(self) -> list[str] | None:
        """The allowed values, None for any."""
        return self._choices

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Set the default, and check the value."""
        known = context.launch_configurations
        context.used_configurations.add(self._name)
        if self._name not in known:
            if self._default is None:
                raise RuntimeError(
                    f"Required launch argument '{self._name}'"
                    f" (description: '{self._description}') was not provided"
                )
            known[self._name] = perform_substitutions(context, self._default)
        value = known[self._name]
        if self._choices is not None and value not in self._choices:
            raise RuntimeError(
                f"Argument '{self._name}' provided value '{value}' is not valid."
                f" Valid options are: {self._choices}"
            )
        return None


class SetLaunchConfiguration(Action):
    """Sets a launch configuration."""

    def __init__(self, name: SomeSubstitutionsType, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._name = normalize_to_list_of_substitutions(name)
        self._value = normalize_to_list_of_substitutions(
            str(value) if isinstance(value, (bool, int, float)) else value
        )

    @property
    def name(self) -> list[Substitution]:
        """The name of the configuration."""
        return self._name

    @property
    def value(self) -> list[Substitution]:
        """The new value."""
        return self._value

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Set the configuration."""
        name = perform_substitutions(context, self._name)
        context.launch_configurations[name] = perform_substitutions(context, self._value)
        return None


class UnsetLaunchConfiguration(Action):
    """Removes a launch configuration."""

    def __init__(self, name: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._name = normalize_to_list_of_substitutions(name)

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Remove the configuration."""
        context.launch_configurations.pop(perform_substitutions(context, self._name), None)
        return None


class PushLaunchConfigurations(Action):
    """Begins a scope of launch configurations."""

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Begin the scope."""
        context.push_launch_configurations()
        return None


class PopLaunchConfigurations(Action):
    """Ends a scope of launch configurations."""

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Restore the earlier configurations."""
        context.pop_launch_configurations()
        return None


class ResetLaunchConfigurations(Action):
    """Removes all launch configurations except the given ones."""

    def __init__(self, launch_configurations: Mapping[Any, Any] | None = None, **kwargs: Any):
        super().__init__(**kwargs)
        self._kept = dict(launch_configurations or {})

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Set exactly the given configurations."""
        # All are computed first: a value may refer to a configuration of the same name.
        values = {
            perform(context, name): perform(context, value) for name, value in self._kept.items()
        }
        context.launch_configurations.clear()
        context.launch_configurations.update(values)
        return None


class SetEnvironmentVariable(Action):
    """Sets an environment variable for the programs that start later."""

    def __init__(
        self, name: SomeSubstitutionsType, value: SomeSubstitutionsType, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self._name = normalize_to_list_of_substitutions(name)
        self._value = normalize_to_list_of_substitutions(value)

    @property
    def name(self) -> list[Substitution]:
        """The name of the variable."""
        return self._name

    @property
    def value(self) -> list[Substitution]:
        """The new value."""
        return self._value

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Set the variable."""
        name = perform_substitutions(context, self._name)
        context.environment[name] = perform_substitutions(context, self._value)
        return None


class AppendEnvironmentVariable(Action):
    """Adds a part to an environment variable such as `PATH`, at its end or at its front."""

    def __init__(
        self,
        name: SomeSubstitutionsType,
        value: SomeSubstitutionsType,
        prepend: bool | SomeSubstitutionsType = False,
        separator: SomeSubstitutionsType | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._name = normalize_to_list_of_substitutions(name)
        self._value = normalize_to_list_of_substitutions(value)
        self._prepend = prepend
        self._separator = separator

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Add the part."""
        name = perform_substitutions(context, self._name)
        value = perform_substitutions(context, self._value)
        separator = os.pathsep if self._separator is None else perform(context, self._separator)
        in_front = self._prepend
        if not isinstance(in_front, bool):
            in_front = perform(context, in_front).lower() in ("true", "1")
        old = context.environment.get(name)
        parts = [value] if old is None else [value, old] if in_front else [old, value]
        context.environment[name] = separator.join(parts)
        return None


class UnsetEnvironmentVariable(Action):
    """Removes an environment variable."""

    def __init__(self, name: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._name = normalize_to_list_of_substitutions(name)

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Remove the variable."""
        context.environment.pop(perform_substitutions(context, self._name), None)
        return None


class PushEnvironment(Action):
    """Begins a scope of environment variables."""

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Begin the scope."""
        context.push_environment()
        return None


class PopEnvironment(Action):
    """Ends a scope of environment variables."""

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Restore the earlier variables."""
        context.pop_environment()
        return None


class ResetEnvironment(Action):
    """Restores the environment variables from before the launch."""

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Restore the variables."""
        context.reset_environment()
        return None


class ReplaceEnvironmentVariables(Action):
    """Sets exactly the given environment variables."""

    def __init__(self, environment: Mapping[Any, Any] | None = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._values = dict(environment or {})

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Set the variables and remove all others."""
        replace_environment(
            {perform(context, name): perform(context, each) for name, each in self._values.items()}
        )
        return None
