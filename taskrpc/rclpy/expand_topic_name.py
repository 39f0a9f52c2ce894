"""Expands the relative or private name of a topic."""

from __future__ import annotations

from taskrpc import names
from taskrpc.errors import InvalidName


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """The absolute name: `x` is in the namespace, `~/x` under the node, `{node}` is its name.

    Raises ValueError for a name that breaks a rule, and for an unknown substitution.
    """
    names.check_node_name(node_name)
    if not node_namespace.startswith("/"):
        problem = "namespace must be absolute, it must lead with a '/'"
        raise InvalidName(node_namespace, 0, kind="namespace", problem=problem)
    names.check_namespace(node_namespace)
    return names.expand(topic_name, namespace=node_namespace, node=node_name, kind="topic name")
