"""Values with types: texts of launch files that become numbers, truth values or lists."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import yaml

from taskrpc.spi import yaml_text

from ..launch_context import LaunchContext
from ..substitution import (
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)

SCALAR_TYPES = (int, float, bool, str)


def coerce_to_type(value: str, data_type: Any = None, can_be_str: bool = False) -> Any:
    """Turn a text into a value of this type; with None, into what YAML makes of it.

    Raises ValueError if the text is no such value.
    """
    if data_type is str:
        return value
    if data_type is bool:
        if value.lower() in ("true", "yes", "on", "1"):
            return True
        if value.lower() in ("false", "no", "off", "0"):
            return False
        raise ValueError(f"Cannot convert value '{value}' to a bool")
    if data_type in (int, float):
        return data_type(value)
    try:
        found = yaml_text.load(value)
    except yaml.YAMLError:
        found = None
    if data_type is None:
        known = isinstance(found, SCALAR_TYPES) or _is_uniform(found)
        return found if known else value
    if isinstance(found, list):
        return found
    raise ValueError(f"Cannot convert value '{value}' to '{data_type}'")


def _is_uniform(value: Any) -> bool:
    """Return whether a value is a list of scalars of one type."""
    if not isinstance(value, list):
        return False
    kinds = {type(each) for each in value}
    return len(kinds) <= 1 and kinds <= set(SCALAR_TYPES)


def perform_typed_substitution(context: LaunchContext, value: Any, data_type: Any = None) -> Any:
    """Compute substitutions and turn the text into a value of this type; keep other values."""
    if isinstance(value, (bool, int, float)):
        return value
    if isinstance(value, (str, Substitution)) or _has_substitutions(value):
        subs = normalize_to_list_of_substitutions(value)
        return coerce_to_type(perform_substitutions(context, subs), data_type)
    return value


def _has_substitutions(value: Any) -> bool:
    return isinstance(value, Iterable) and all(
        isinstance(each, (str, Substitution)) for each in value
    )
