"""Checks a value against a descriptor: its type, its range, and whether it is read-only."""

from __future__ import annotations

import math
from typing import Any

from ...parameter import Parameter

WRONG_TYPE = "Wrong parameter type"
"""How the reason begins when the value has another type."""

RELATIVE_TOLERANCE = 1e-6
"""The relative tolerance of floats at the ends and the steps of their range."""


def refusal(parameter: Parameter, descriptor: Any, declared: bool, changes: bool) -> str:
    """Why the parameter cannot be set to this value; empty when it can.

    Args:
        parameter: the parameter with its new value.
        descriptor: the rules for the value; with dynamic typing, gets the type of the value.
        declared: whether a parameter of this name is declared already.
        changes: whether this is a change, which a read-only parameter does not allow.
    """
    if changes and descriptor.read_only:
        return f"Trying to set a read-only parameter: {parameter.name}."
    if descriptor.dynamic_typing:
        descriptor.type = parameter.type_.value
    elif parameter.type_ == Parameter.Type.NOT_SET:
        return "Static parameter cannot be undeclared" if declared else ""
    elif parameter.type_.value != descriptor.type:
        expected = Parameter.Type(descriptor.type)
        return f"{WRONG_TYPE}, expected '{expected}' got '{parameter.type_}'"
    if parameter.type_ == Parameter.Type.INTEGER and descriptor.integer_range:
        return _outside_integers(parameter, descriptor.integer_range[0])
    if parameter.type_ == Parameter.Type.DOUBLE and descriptor.floating_point_range:
        return _outside_floats(parameter, descriptor.floating_point_range[0])
    return ""


def _outside_integers(parameter: Parameter, limits: Any) -> str:
    least, most = sorted((limits.from_value, limits.to_value))
    value = parameter.value
    if value in (least, most):  # the ends are allowed even if they are not a step
        return ""
    if not least < value < most:
        return f"Parameter {parameter.name} out of range. Min: {least}, Max: {most}, value: {value}"
    if limits.step and (value - least) % limits.step:
        return (
            f"The parameter value for {parameter.name} is not a valid step. "
            f"Min: {least}, max: {most}, value: {value}, step: {limits.step}"
        )
    return ""


def _outside_floats(parameter: Parameter, limits: Any) -> str:
    least, most = sorted((limits.from_value, limits.to_value))
    value = parameter.value
    if _close(value, least) or _close(value, most):
        return ""
    if not least < value < most:
        return f"Parameter {parameter.name} out of range Min: {least}, Max: {most}, value: {value}"
    if limits.step:
        steps = round((value - least) / limits.step)
        if not _close(least + steps * limits.step, value):
            return (
                f"The parameter value for {parameter.name} is not close enough to a valid step. "
                f"Min: {least}, max: {most}, value: {value}, step: {limits.step}"
            )
    return ""


def _close(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=RELATIVE_TOLERANCE)
