"""The nodes of a notebook: a cell that runs again replaces its nodes instead of adding to them.

Two rules hold for nodes of rclpy, of `taskrpc.sync` and of `taskrpc`: a new node replaces the
earlier one of its name, and the next run of a cell ends the nodes that its last run made.
"""

from __future__ import annotations

import asyncio
import contextlib
import weakref
from collections.abc import Callable
from typing import Any, NamedTuple

from taskrpc.course.notebook.calls import CallList
from taskrpc.spi import ObservedNode

_LONGEST = 5.0
"""Seconds that the end of a node may take."""


class _Made(NamedTuple):
    """A node, and the cell that made it."""

    node: Any
    cell: str
    loop: asyncio.AbstractEventLoop


class NotebookNodes(CallList):
    """Knows the nodes of a notebook, and their calls.

    It observes all nodes that have no other observer; rclpy also announces its nodes.
    """

    def __init__(self) -> None:
        super().__init__()
        self.leaves: Callable[[Any], None] = lambda node: None
        """Called with each rclpy node before it is destroyed."""
        self._cell = ""
        """The id of the running cell; "" if it has none, as at a prompt."""
        self._made: list[_Made] = []
        """The native nodes, also those inside of rclpy nodes."""
        self._rclpy: dict[str, tuple[weakref.ref[Any], str]] = {}
        """The rclpy nodes by their full names, with the cells that made them."""

    def cell_begins(self, cell: str) -> None:
        """A cell is about to run: the nodes of its last run end."""
        self._cell = cell
        if not cell:
            return
        for name in [name for name, (_, maker) in self._rclpy.items() if maker == cell]:
            self._destroy_rclpy(name)
        for made in [each for each in self._made if each.cell == cell]:
            self._destroy(made)

    # Of rclpy

    def node_joins(self, node: Any, name: str) -> None:
        """A node of rclpy is about to join the network; an earlier one of this name leaves."""
        self._destroy_rclpy(name)
        self._rclpy[name] = weakref.ref(node), self._cell

    def _destroy_rclpy(self, name: str) -> None:
        reference, _ = self._rclpy.pop(name, (None, ""))
        node = None if reference is None else reference()
        if node is not None:
            self.leaves(node)
            with contextlib.suppress(AttributeError):  # its constructor has failed
                node.destroy_node()

    # Of taskrpc, as an observer

    def node_started(self, node: ObservedNode) -> None:
        """A node joined the network; an earlier one of this name leaves."""
        loop = asyncio.get_running_loop()
        name = node.get_fully_qualified_name()
        for each in list(self._made):
            if each.loop is loop and each.node.get_fully_qualified_name() == name:
                self._destroy(each)
        self._made.append(_Made(node, self._cell, loop))

    def node_ended(self, node: ObservedNode) -> None:
        """A node is about to leave the network."""
        self._made = [each for each in self._made if each.node is not node]

    def _destroy(self, made: _Made) -> None:
        """End a native node; wait for it, unless the caller is on the loop that must end it."""
        self.node_ended(made.node)
        if made.loop.is_closed():
            return
        try:
            own = asyncio.get_running_loop()
        except RuntimeError:
            own = None
        if own is made.loop:
            made.loop.create_task(made.node.destroy())
        else:
            ending = asyncio.run_coroutine_threadsafe(made.node.destroy(), made.loop)
            with contextlib.suppress(TimeoutError):
                ending.result(_LONGEST)
