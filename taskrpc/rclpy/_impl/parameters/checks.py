"""Whether a descriptor allows a value: its type, its range, and whether it may change at all."""

from __future__ import annotations

import math
from typing import Any

from ...parameter import Parameter

WRONG_TYPE = "Wrong parameter type"
"""How the reason begins where the type is another."""

RELATIVE_TOLERANCE = 1e-6
"""By how much a float may miss the ends and the steps of its range."""


def refusal(parameter: Parameter, descriptor: Any, declared: bool, changes: bool) -> str:
    """Why the parameter cannot be set so; empty when it can.

    Args:
        parameter: what it would be.
        descriptor: what it must fit; its type is set to the value's where that may change.
        declared: whether there is such a parameter already.
        changes: whether that is a change, which a read-only parameter does not allow.
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
    if value in (least, most):  # allowed even where no step leads there
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
