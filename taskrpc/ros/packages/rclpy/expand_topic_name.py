"""Expands the relative or private name of a topic."""

from __future__ import annotations

from functools import partial

from taskrpc.errors import InvalidName
from taskrpc.spi import names

from ._impl.graph.names import ros_problem
from .validate_namespace import check_namespace


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """The absolute name: `x` is in the namespace, `~/x` under the node, `{node}` is its name.

    Raises ValueError for a name that breaks a rule, and for an unknown substitution.
    """
    for kind, name in (
        ("topic name", topic_name),
        ("node name", node_name),
        ("node namespace", node_namespace),
    ):
        if not isinstance(name, str):
            raise TypeError(f"expected a {kind} (str), got {name!r}")
    kind, name = "node name", node_name
    expand = partial(names.expand, namespace=node_namespace, node=node_name, kind="topic name")
    try:
        names.check_node_name(node_name)
        kind, name = "node namespace", node_namespace
        check_namespace(node_namespace)
        kind, name = "topic name", topic_name
        return expand(topic_name)
    except InvalidName as error:
        raise ValueError(f"{kind} '{name}' is invalid: {ros_problem(error)}") from None
