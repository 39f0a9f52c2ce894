"""Parameters in launch files: values with a type, and parameter files."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from launch.frontend.parser import Parser
from launch.substitution import (
    normalize_to_list_of_substitutions,
    perform,
    perform_substitutions,
)
from launch.utilities.type_utils import perform_typed_substitution

from taskrpc.spi import yaml_text


class ParameterValue:
    """A parameter's value with its type; without a type, YAML's rules decide.

    Args:
        value: a value or substitutions.
        value_type: `str`, `int`, `float`, `bool`, or a list of one of these.
    """

    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        self._value = value
        self._type = value_type

    @property
    def value(self) -> Any:
        """The value, before it is computed."""
        return self._value

    @property
    def value_type(self) -> Any:
        """The type, None if YAML's rules decide."""
        return self._type

    def evaluate(self, context: Any) -> Any:
        """Compute the value."""
        if self._type is None:
            return value_of(context, "", self._value)
        return perform_typed_substitution(context, self._value, self._type)


class Parameter:
    """A parameter with its name."""

    def __init__(
        self,
        name: Any,
        value: Any,
        *,
        value_type: Any = None,
        description: Any = "",
    ) -> None:
        self._name = normalize_to_list_of_substitutions(name)
        self._value = ParameterValue(value, value_type=value_type)

    @property
    def name(self) -> Any:
        """The name, before it is computed."""
        return self._name

    @property
    def value(self) -> Any:
        """The value, before it is computed."""
        return self._value.value

    def evaluate(self, context: Any) -> tuple[str, Any]:
        """Compute name and value."""
        return perform_substitutions(context, self._name), self._value.evaluate(context)


class ParameterFile:
    """A parameter file.

    Args:
        param_file: its path.
        allow_substs: replace `$(…)` in its text.
    """

    def __init__(self, param_file: Any, *, allow_substs: Any = False) -> None:
        self._path = param_file
        self._allow_substs = allow_substs

    @property
    def param_file(self) -> Any:
        """The path, before it is computed."""
        return self._path

    @property
    def allow_substs(self) -> Any:
        """Whether `$(…)` in its text is replaced."""
        return self._allow_substs

    def evaluate(self, context: Any) -> Path:
        """Return the path, that of a temporary file if substitutions were replaced."""
        path = Path(perform(context, self._path))
        if not perform_typed_substitution(context, self._allow_substs, bool):
            return path
        # A parser knows the substitutions of ROS, too.
        parts = Parser().parse_substitution(path.read_text("utf-8"))
        text = perform_substitutions(context, parts)
        try:
            yaml_text.load(text)
        except yaml.YAMLError as error:
            raise RuntimeError(
                f"The substituted parameter file is not a valid yaml file: {path}: {error}"
            ) from None
        return temporary_file(context, text)


def value_of(context: Any, name: str, value: Any) -> Any:
    """Compute a parameter's value: a number, a truth value, a text, or a list of these.

    Texts and substitutions become what YAML makes of them, as in ROS: `'3'` is a number.
    """
    if isinstance(value, ParameterValue):
        return value.evaluate(context)
    if value is None or isinstance(value, (bool, int, float)):
        return value
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, (str, os.PathLike)) or hasattr(value, "perform"):
        return _of_text(name, perform(context, value))
    if not isinstance(value, Iterable):
        what = f"parameter {name}" if name else "the value of a parameter"
        raise TypeError(
            f"{what}: expected a number, a truth value, a text or a list of these, got {value!r}"
        )
    items = list(value)
    if any(hasattr(each, "perform") for each in items):
        return _of_text(name, perform(context, items))
    return [each if isinstance(each, str) else value_of(context, name, each) for each in items]


def _of_text(name: str, text: str) -> Any:
    try:
        found = yaml_text.load(text)
    except yaml.YAMLError:
        raise TypeError(
            f"Unable to parse the value of parameter {name} as yaml. If the parameter is meant to"
            " be a string, try wrapping it in"
            " launch_ros.parameter_descriptions.ParameterValue(value, value_type=str)"
        ) from None
    is_plain = isinstance(found, (bool, int, float, str, list))
    return found if is_plain else text


def temporary_file(context: Any, text: str) -> Path:
    """Write a file that exists until the launch ends."""
    descriptor, name = tempfile.mkstemp(prefix="launch_params_", suffix=".yaml")
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)

    async def remove() -> None:
        with contextlib.suppress(OSError):
            os.remove(name)

    context.at_end.append(remove)
    return Path(name)
