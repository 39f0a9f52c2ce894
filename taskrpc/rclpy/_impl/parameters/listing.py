"""Which names of parameters a listing has."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import srvgen

from ...parameter import PARAMETER_SEPARATOR_STRING

ListParameters = srvgen.load("rcl_interfaces/srv/ListParameters")
ListParametersResult = srvgen.load("rcl_interfaces/msg/ListParametersResult")


def listed(names: Iterable[str], prefixes: object, depth: object) -> Any:
    """The names that are one of the prefixes or so near below one, with the groups they are in."""
    checked, most = _checked(prefixes, depth)
    result = ListParametersResult()
    for name in names:
        if _is_listed(name, checked, most):
            result.names.append(name)
            group, separator, _ = name.rpartition(PARAMETER_SEPARATOR_STRING)
            if separator and group not in result.prefixes:
                result.prefixes.append(group)
    return result


def _checked(prefixes: object, depth: object) -> tuple[list[str], int]:
    """Both, if they can be what they are for. Raises TypeError, ValueError."""
    if not isinstance(prefixes, list):
        raise TypeError("The prefixes argument must be a list")
    if not all(isinstance(prefix, str) for prefix in prefixes):
        raise TypeError("All prefixes must be instances of type str")
    if not isinstance(depth, int):
        raise TypeError("The depth must be instance of type int")
    if depth < 0:
        raise ValueError("The depth must be greater than or equal to zero")
    return prefixes, depth


def _is_listed(name: str, prefixes: list[str], depth: int) -> bool:
    """Whether a name is one of the prefixes or near enough below one."""
    if not prefixes:
        return _is_near(name, depth)
    for prefix in prefixes:
        below = name.removeprefix(prefix + PARAMETER_SEPARATOR_STRING)
        if name == prefix or (below != name and _is_near(below, depth)):
            return True
    return False


def _is_near(name: str, depth: int) -> bool:
    return (
        depth == ListParameters.Request.DEPTH_RECURSIVE
        or name.count(PARAMETER_SEPARATOR_STRING) < depth
    )
