"""Substitutions that return the path of a changed parameter file, or a fact about one."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from launch.substitution import (
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform,
)
from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import temporary_file

from taskrpc.spi import os_errors, yaml_text

from ..rewriting import rewritten


class RewrittenYaml(Substitution):
    """The path of a copy of a parameter file, with other values.

    Args:
        source_file: the path of the file.
        param_rewrites: new values by a parameter's name or path.
        root_key: a key above everything, usually a namespace; none if it is empty.
        key_rewrites: new names of keys.
        convert_types: turn new values into numbers where possible.
        value_rewrites: new values by their old values.
    """

    def __init__(
        self,
        source_file: Any,
        param_rewrites: Mapping[str, Any],
        root_key: Any = None,
        key_rewrites: Mapping[str, Any] | None = None,
        convert_types: bool = False,
        value_rewrites: Mapping[str, Any] | None = None,
    ) -> None:
        self._source = normalize_to_list_of_substitutions(source_file)
        self._parameters = dict(param_rewrites)
        self._root_key = root_key
        self._keys = dict(key_rewrites or {})
        self._values = dict(value_rewrites or {})
        self._convert_types = convert_types

    @property
    def name(self) -> Any:
        """The path of the original file, before it is computed."""
        return self._source

    def perform(self, context: Any) -> str:
        """Write the copy and return its path; raises SubstitutionFailure if that is impossible."""
        data = rewritten(
            _loaded(perform(context, self._source)),
            _performed(context, self._parameters),
            keys=_performed(context, self._keys),
            values=_performed(context, self._values),
            converts_numbers=self._convert_types,
        )
        root_key = "" if self._root_key is None else perform(context, self._root_key)
        if root_key:
            data = {root_key: data}
        text = yaml.safe_dump(data, allow_unicode=True, sort_keys=False)
        return str(temporary_file(context, text))


class ReplaceString(Substitution):
    """The path of a copy of a file in which some texts are replaced.

    Args:
        source_file: the path of the file.
        replacements: new texts by old texts.
        condition: if it does not hold, the path of the original file is returned.
    """

    def __init__(
        self, source_file: Any, replacements: Mapping[str, Any], condition: Any = None
    ) -> None:
        self._source = normalize_to_list_of_substitutions(source_file)
        self._replacements = dict(replacements)
        self._condition = condition

    @property
    def name(self) -> Any:
        """The path of the original file, before it is computed."""
        return self._source

    @property
    def condition(self) -> Any:
        """The condition, None for always."""
        return self._condition

    def perform(self, context: Any) -> str:
        """Write the copy and return its path."""
        path: str = perform(context, self._source)
        if self._condition is not None and not self._condition.evaluate(context):
            return path
        text = _text(path)
        for old, new in _performed(context, self._replacements).items():
            text = text.replace(old, new)
        return str(temporary_file(context, text))


class HasNodeParams(Substitution):
    """`True` if a parameter file has parameters for a node, else `False`."""

    def __init__(self, source_file: Any, node_name: str) -> None:
        self._source = normalize_to_list_of_substitutions(source_file)
        self._node_name = node_name

    @property
    def name(self) -> Any:
        """The path of the file, before it is computed."""
        return self._source

    def perform(self, context: Any) -> str:
        """Look for the node's name among the outermost keys."""
        data = _loaded(perform(context, self._source))
        return str(isinstance(data, dict) and self._node_name in data)


class LaunchConfigAsBool(Substitution):
    """A launch configuration as `True` or `False`; `1`, `yes` and `on` are true, too."""

    def __init__(self, name: str) -> None:
        self._configuration = LaunchConfiguration(name)

    def describe(self) -> str:
        """Describe the substitution."""
        return str(self._configuration.describe())

    def perform(self, context: Any) -> str:
        """Look the configuration up."""
        value: str = self._configuration.perform(context)
        return str(value.strip().lower() in ("true", "1", "yes", "on"))


class ParseMultiRobotPose:
    """The poses of several robots on the command line: `robots:="name={x: 1.0, y: 2.0}; …"`."""

    def __init__(self, target_argument: str) -> None:
        self._argument = target_argument

    def value(self) -> dict[str, dict[str, float]]:
        """The pose of each robot by its name; x, y, z, roll, pitch and yaw are 0 if missing."""
        front = f"{self._argument}:="
        given = [word.removeprefix(front) for word in sys.argv if word.startswith(front)]
        found = {}
        for part in "".join(given[-1:]).split(";"):
            name, sign, pose = part.partition("=")
            if sign and name.strip():
                values = yaml_text.load(pose) or {}
                names = ("x", "y", "z", "roll", "pitch", "yaw")
                found[name.strip()] = {each: float(values.get(each, 0.0)) for each in names}
        return found


def _performed(context: Any, values: Mapping[str, Any]) -> dict[str, str]:
    return {name: perform(context, value) for name, value in values.items()}


def _text(path: str) -> str:
    try:
        return Path(path).read_text("utf-8")
    except OSError as error:
        raise SubstitutionFailure(f"cannot read {path}: {os_errors.reason_of(error)}") from None
    except UnicodeDecodeError:
        raise SubstitutionFailure(f"cannot read {path}: expected a text in UTF-8") from None


def _loaded(path: str) -> Any:
    try:
        return yaml_text.load(_text(path))
    except yaml.YAMLError as error:
        raise SubstitutionFailure(f"{path} is not valid YAML: {yaml_text.message(error)}") from None
