"""The types of a node's parameters in annotations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, TypeAlias

from .parameter_descriptions import Parameter, ParameterFile

SomeParameterValue: TypeAlias = Any
"""A number, a truth value, a text, substitutions, or a list of these."""

SomeParametersDict: TypeAlias = "Mapping[Any, SomeParameterValue]"

SomeParameters: TypeAlias = (
    "Sequence[str | PathLike[str] | Parameter | ParameterFile | SomeParametersDict]"
)
"""What `Node` takes as `parameters`."""

ParameterValue: TypeAlias = Any
ParametersDict: TypeAlias = SomeParametersDict
Parameters: TypeAlias = SomeParameters
EvaluatedParameterValue: TypeAlias = "str | int | float | bool | Sequence[Any] | bytes"
EvaluatedParameters: TypeAlias = "Sequence[PathLike[str] | Mapping[str, EvaluatedParameterValue]]"
