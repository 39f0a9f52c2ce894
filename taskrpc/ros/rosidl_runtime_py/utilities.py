"""Find the class of a message, service or action whose name is a text."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from srvgen.files import KINDS


def get_interface(identifier: str) -> Any:
    """The class of `package/kind/Name`; `package/Name` is a message.

    Raises ValueError for what is no such name, ImportError for a package or kind that does not
    exist, AttributeError for an interface that does not.
    """
    return _class(identifier, "msg")


def get_message(identifier: str) -> Any:
    """The class of a message; otherwise as `get_interface`."""
    return _class(identifier, "msg", only=True)


def get_service(identifier: str) -> Any:
    """The class of a service, also by `package/Name`; otherwise as `get_interface`."""
    return _class(identifier, "srv", only=True)


def get_action(identifier: str) -> Any:
    """The class of an action, also by `package/Name`; otherwise as `get_interface`."""
    return _class(identifier, "action", only=True)


def _class(identifier: str, kind: str, *, only: bool = False) -> Any:
    parts = identifier.split("/")
    if len(parts) == 2:
        parts.insert(1, kind)
    if len(parts) != 3 or not all(parts) or parts[1] not in KINDS or (only and parts[1] != kind):
        form = f"package/{kind if only else 'kind'}/Name"
        raise ValueError(f"expected the name of an interface as {form}, got '{identifier}'")
    package, found, name = parts
    return getattr(import_module(f"{package}.{found}"), name)
