"""Checks the name of a node."""

from __future__ import annotations

from taskrpc.spi import names

from ._impl.graph.names import checked


def validate_node_name(node_name: str) -> bool:
    """True for a valid node name; raises InvalidNodeNameException for any other."""
    checked("node name", node_name, names.check_node_name)
    return True
