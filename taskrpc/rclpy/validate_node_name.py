"""Whether a node may have a name."""

from __future__ import annotations

from taskrpc import names
from taskrpc.errors import InvalidName

from ._impl.graph.names import refuse_other_than_text, translated


def validate_node_name(node_name: str) -> bool:
    """True for a valid node name; raises InvalidNodeNameException for any other."""
    refuse_other_than_text(node_name, "node name")
    try:
        names.check_node_name(node_name)
    except InvalidName as error:
        raise translated(error) from None
    return True
