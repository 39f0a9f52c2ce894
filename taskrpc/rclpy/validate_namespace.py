"""Whether a node may have a namespace."""

from __future__ import annotations

from taskrpc import names
from taskrpc.errors import InvalidName

from ._impl.graph.names import refuse_other_than_text, translated
from .exceptions import InvalidNamespaceException


def validate_namespace(namespace: str) -> bool:
    """True for a valid absolute namespace; raises InvalidNamespaceException for any other."""
    refuse_other_than_text(namespace, "namespace")
    if not namespace:
        raise InvalidNamespaceException(namespace, "namespace must not be empty", 0)
    if not namespace.startswith("/"):
        problem = "namespace must be absolute, it must lead with a '/'"
        raise InvalidNamespaceException(namespace, problem, 0)
    try:
        names.check_namespace(namespace)
    except InvalidName as error:
        raise translated(error) from None
    return True
