"""Finds the class of a message, service or action by its name."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from srvgen.classes.slot_types import NamespacedType
from srvgen.convert import is_message_class
from srvgen.files.reading import KINDS


def get_interface(identifier: str) -> Any:
    """The class of `package/kind/Name`; `package/Name` is a message.

    Raises ValueError for an invalid name, ImportError if the package or kind does not exist, and
    AttributeError if the interface does not exist.
    """
    return _class(identifier, "msg")


def get_message(identifier: str) -> Any:
    """The class of a message; errors as `get_interface`."""
    return _class(identifier, "msg", only=True)


def get_service(identifier: str) -> Any:
    """The class of a service, also by `package/Name`; errors as `get_interface`."""
    return _class(identifier, "srv", only=True)


def get_action(identifier: str) -> Any:
    """The class of an action, also by `package/Name`; errors as `get_interface`."""
    return _class(identifier, "action", only=True)


def get_namespaced_type(identifier: str) -> NamespacedType:
    """The type of an interface, as `SLOT_TYPES` holds it; names as in `get_interface`."""
    return NamespacedType(*_parts(identifier, "msg"))


def get_message_namespaced_type(identifier: str) -> NamespacedType:
    """The type of a message; names as in `get_message`."""
    return NamespacedType(*_parts(identifier, "msg", only=True))


def get_service_namespaced_type(identifier: str) -> NamespacedType:
    """The type of a service; names as in `get_service`."""
    return NamespacedType(*_parts(identifier, "srv", only=True))


def get_action_namespaced_type(identifier: str) -> NamespacedType:
    """The type of an action; names as in `get_action`."""
    return NamespacedType(*_parts(identifier, "action", only=True))


def is_message(interface: Any) -> bool:
    """Whether an object is the class of a message."""
    return is_message_class(interface)


def is_service(interface: Any) -> bool:
    """Whether an object is the class of a service."""
    return hasattr(interface, "Request") and hasattr(interface, "Response")


def is_action(interface: Any) -> bool:
    """Whether an object is the class of an action."""
    return all(hasattr(interface, name) for name in ("Goal", "Result", "Feedback"))


def _class(identifier: str, kind: str, *, only: bool = False) -> Any:
    (package, found), name = _parts(identifier, kind, only=only)
    return getattr(import_module(f"{package}.{found}"), name)


def _parts(identifier: str, kind: str, *, only: bool = False) -> tuple[list[str], str]:
    """The package and the kind of an interface, and its name."""
    parts = identifier.split("/")
    if len(parts) == 2:
        parts.insert(1, kind)
    if len(parts) != 3 or not all(parts) or parts[1] not in KINDS or (only and parts[1] != kind):
        form = f"package/{kind if only else 'kind'}/Name"
        raise ValueError(f"expected the name of an interface as {form}, got '{identifier}'")
    return parts[:2], parts[2]
