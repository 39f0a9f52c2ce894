"""Checks the name of a parameter."""

from __future__ import annotations

from .exceptions import InvalidParameterException


def validate_parameter_name(name: str) -> bool:
    """True for a valid parameter name; raises InvalidParameterException for an empty one."""
    if not isinstance(name, str):
        raise TypeError(f"expected a parameter name (str), got {name!r}")
    if not name:
        raise InvalidParameterException(name)
    return True
