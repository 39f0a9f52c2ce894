"""Reads the tuples of `declare_parameters`: a name, a value or type, a descriptor."""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import srvgen

from ...parameter import Parameter, ParameterValue, parameter_value_to_python
from ...validate_parameter_name import validate_parameter_name

ParameterDescriptor = srvgen.load("rcl_interfaces/msg/ParameterDescriptor")

_HERE = str(Path(__file__).parents[2])
"""The folder of rclpy."""


@dataclass
class Declaration:
    """One parameter that is being declared."""

    name: str
    value: Any
    """None if only a type is given."""
    descriptor: Any
    """Has the type of the parameter, unless it has dynamic typing."""


def declaration(index: int, entry: tuple[Any, ...], namespace: str) -> Declaration:
    """Read the entry at an index of the list.

    Raises:
        TypeError: the entry does not have the form (name, value or type, descriptor).
        ValueError: a statically typed parameter has no type.
        InvalidParameterException: the name is empty.
    """
    if not 1 <= len(entry) <= 3:
        raise TypeError(
            f"Invalid parameter tuple length at index {index} in parameters list: "
            f"{entry}; expecting length between 1 and 3"
        )
    name = _full_name(index, entry[0], namespace)
    descriptor = entry[2] if len(entry) == 3 else ParameterDescriptor()
    if not isinstance(descriptor, ParameterDescriptor):
        raise TypeError(
            f"Third element {descriptor} at index {index} in parameters list "
            "is not a ParameterDescriptor."
        )
    if len(entry) == 1:
        _warn_of_a_name_alone(name)
        descriptor.dynamic_typing = True
    second = entry[1] if len(entry) > 1 else None
    if isinstance(second, Parameter.Type):
        descriptor.type = _static_type(name, second, descriptor)
        return Declaration(name, None, descriptor)
    if not descriptor.dynamic_typing:
        descriptor.type = _type_of_default(second)
    if isinstance(second, ParameterValue):
        second = parameter_value_to_python(second)
    return Declaration(name, second, descriptor)


def _full_name(index: int, name: object, namespace: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"First element {name} at index {index} in parameters list is not a str.")
    full = f"{namespace}.{name}" if namespace else name
    validate_parameter_name(full)
    return full


def _static_type(name: str, kind: Any, descriptor: Any) -> int:
    if kind == Parameter.Type.NOT_SET:
        raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
    if descriptor.dynamic_typing:
        raise ValueError(
            f"When declaring parameter {{{name}}} passing a descriptor with"
            "`dynamic_typing=True` is not allowed when the parameter type is provided"
        )
    number: int = kind.value
    return number


def _type_of_default(value: Any) -> int:
    if isinstance(value, ParameterValue):
        number: int = value.type
    else:
        number = Parameter.Type.from_parameter_value(value).value
    if number == Parameter.Type.NOT_SET.value:
        raise ValueError(
            "Cannot declare a statically typed parameter with default value "
            "of type PARAMETER_NOT_SET"
        )
    return number


def _warn_of_a_name_alone(name: str) -> None:
    warnings.warn(
        f"when declaring parameter named '{name}', "
        "declaring a parameter only providing its name is deprecated. "
        "You have to either:\n"
        '\t- Pass a name and a default value different to "PARAMETER NOT SET"'
        " (and optionally a descriptor).\n"
        "\t- Pass a name and a parameter type.\n"
        "\t- Pass a name and a descriptor with `dynamic_typing=True",
        stacklevel=_levels_to_the_program(),
    )


def _levels_to_the_program() -> int:
    """How many calls the program is above the function that warns, for `stacklevel`."""
    levels, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_HERE):
        levels, frame = levels + 1, frame.f_back
    return levels
