"""Which names of the robot other machines may use. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable
from fnmatch import translate

_OF_EVERY_NODE = (
    "describe_parameters",
    "get_logger_levels",
    "get_parameter_types",
    "get_parameters",
    "get_type_description",
    "list_parameters",
    "set_logger_levels",
    "set_parameters",
    "set_parameters_atomically",
)
"""The services that every node of ROS has; with them a caller can change any node."""


class Allowed:
    """A list of names with `*` and `?`, such as `/arm/*`; `*` stands for slashes too.

    Hidden names (a part begins with `_`) are never allowed. The services that every node of ROS
    has are allowed only if a pattern ends with their name, such as `/arm/get_parameters`.
    """

    def __init__(self, patterns: Iterable[str]) -> None:
        absolute = [each if each.startswith(("/", "*")) else f"/{each}" for each in patterns]
        self._matches = [re.compile(translate(each)).match for each in absolute]
        self._ends = {each.rpartition("/")[2] for each in absolute}

    def __contains__(self, name: str) -> bool:
        end = name.rpartition("/")[2]
        if "/_" in name or (end in _OF_EVERY_NODE and end not in self._ends):
            return False
        return any(matches(name) for matches in self._matches)
