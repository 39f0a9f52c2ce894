"""Helpers of ROS's `launch.utilities` that programs import.

They turn arguments into substitutions, compute substitutions, and normalise paths. Values with
types are in `type_utils`. Nothing here starts programs.
"""

from __future__ import annotations

import os
from typing import Any

from ..launch_context import LaunchContext
from ..launch_description_entity import entities_of as normalize_to_list_of_entities
from ..launch_description_entity import visit_all_entities_and_collect_futures
from ..substitution import normalize_to_list_of_substitutions, perform_substitutions


def is_a(obj: Any, entity_type: type) -> bool:
    """Return whether an object is of this type, or of a subclass."""
    return isinstance(obj, entity_type)


is_a_subclass = is_a


def ensure_argument_type(argument: Any, types: Any, argument_name: str, caller: str = "") -> None:
    """Raise TypeError if an argument is not of one of these types."""
    wanted = tuple(types) if isinstance(types, (list, tuple)) else (types,)
    if not isinstance(argument, wanted):
        names = ", ".join(each.__name__ for each in wanted)
        front = f"{caller} " if caller else ""
        raise TypeError(
            f"{front}expected '{argument_name}' to be of type {names}, got {type(argument)}"
        )


def normalize_path(context: LaunchContext, path: Any) -> str:
    """Compute a path, with `~` and variables replaced, as an absolute path."""
    text = perform_substitutions(context, normalize_to_list_of_substitutions(path))
    return os.path.abspath(os.path.expandvars(os.path.expanduser(text)))


__all__ = [
    "ensure_argument_type",
    "is_a",
    "is_a_subclass",
    "normalize_path",
    "normalize_to_list_of_entities",
    "normalize_to_list_of_substitutions",
    "perform_substitutions",
    "visit_all_entities_and_collect_futures",
]
