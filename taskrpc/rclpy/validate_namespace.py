"""Checks the namespace of a node."""

from __future__ import annotations

from taskrpc import names

from ._impl.graph.names import checked
from .exceptions import InvalidNamespaceException


def validate_namespace(namespace: str) -> bool:
    """True for a valid absolute namespace; raises InvalidNamespaceException for any other."""
    checked("namespace", namespace, _check)
    return True


def _check(namespace: str) -> None:
    if not namespace:
        raise InvalidNamespaceException(namespace, "namespace must not be empty", 0)
    if not namespace.startswith("/"):
        problem = "namespace must be absolute, it must lead with a '/'"
        raise InvalidNamespaceException(namespace, problem, 0)
    names.check_namespace(namespace)
