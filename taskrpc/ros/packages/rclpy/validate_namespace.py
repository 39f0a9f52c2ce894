"""Checks the namespace of a node."""

from __future__ import annotations

from taskrpc.errors import InvalidName
from taskrpc.spi import names

from ._impl.graph.names import checked


def validate_namespace(namespace: str) -> bool:
    """True for a valid absolute namespace; raises InvalidNamespaceException for any other."""
    checked("namespace", namespace, check_namespace)
    return True


def check_namespace(namespace: str) -> None:
    """Raise `InvalidName` for an invalid absolute namespace."""
    if not namespace:
        problem = "namespace must not be empty"
        raise InvalidName(namespace, 0, kind="namespace", problem=problem)
    if not namespace.startswith("/"):
        problem = "namespace must be absolute, it must lead with a '/'"
        raise InvalidName(namespace, 0, kind="namespace", problem=problem)
    names.check_namespace(namespace)
