"""The connection to a notebook, whose cells run again.

`init` may be repeated there, and a new node replaces an earlier one. `taskrpc.course.notebook`
sets this.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from .node_interface import NodeInterface


class Cells(Protocol):
    """The cells of a notebook."""

    def node_joins(self, node: NodeInterface, name: str) -> None:
        """A node is about to join the network; an earlier one of this full name has to leave."""


current: Cells | None = None
"""The cells of the notebook that the program is; None for every other program."""
