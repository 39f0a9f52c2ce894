"""Finds the class of a message by a type of `rosidl_parser.definition`."""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

from srvgen.classes.slot_types import AbstractNestedType, AbstractType, NamespacedType


def import_message_from_namespaced_type(message_type: AbstractType) -> Any:
    """The class of an interface; for an array, the class of its elements, with a warning.

    Raises ImportError if the package does not exist, AttributeError if the interface does not
    exist, and TypeError for the type of any other value.
    """
    if isinstance(message_type, AbstractNestedType):
        warnings.warn(
            "Passing an AbstractNestedType is deprecated; pass its value_type",
            DeprecationWarning,
            stacklevel=2,
        )
        message_type = message_type.value_type
    if not isinstance(message_type, NamespacedType):
        raise TypeError(f"expected a NamespacedType, got {message_type}")
    return getattr(import_module(".".join(message_type.namespaces)), message_type.name)
