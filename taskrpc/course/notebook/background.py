"""Spins rclpy nodes in the background, so that their callbacks run while other cells run."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from typing import Any

from taskrpc.course.notebook.errors import OWN
from taskrpc.course.notebook.jupyter import cell_name

_LOOK = 0.1
"""Seconds between two looks whether a foreground spin has given the node back."""


class Spinner:
    """Runs the callbacks of one node on a thread of its own, as a program of its own would.

    A cell may spin the same node, for example with `spin_until_future_complete`. The cell's
    executor then has the node until its spin ends.

    Args:
        node: a node of rclpy.
        report: gets the exception of a callback; the node continues.
    """

    def __init__(self, node: Any, report: Callable[[BaseException], object]) -> None:
        from rclpy.executors import SingleThreadedExecutor

        self.node = node
        self._report = report
        self._executor = SingleThreadedExecutor(context=node.context)
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"spin {node.get_name()}")
        self._thread.daemon = True
        self._thread.start()

    def stop(self) -> None:
        """Stop; a callback that runs now is not interrupted."""
        self._is_over.set()
        self._executor.shutdown()

    @property
    def is_running(self) -> bool:
        """Whether the node's callbacks still run in the background."""
        return self._thread.is_alive()

    def _run(self) -> None:
        while not self._is_over.is_set() and self.node.handle.valid and self.node.context.ok():
            self._take_back()
            try:
                self._executor.spin_once(timeout_sec=_LOOK)
            except Exception as error:
                # A node that was destroyed or a shutdown also ends the wait with an exception.
                if self.node.handle.valid and self.node.context.ok() and not self._is_over.is_set():
                    self._report(error)

    def _take_back(self) -> None:
        other = self.node.executor
        if other is None or not other.has_node(self.node):
            self._executor.add_node(self.node)


class Spinners:
    """The nodes that spin in the background."""

    def __init__(self) -> None:
        self._running: list[Spinner] = []

    def spin(self, node: Any) -> None:
        """Spin a node in the background; does nothing if it does already."""
        self._running = [each for each in self._running if each.is_running]
        if not any(each.node is node for each in self._running):
            self._running.append(Spinner(node, print_error))

    def stop(self, node: Any) -> None:
        """Stop spinning a node."""
        for each in self._running:
            if each.node is node:
                each.stop()


def print_error(error: BaseException) -> None:
    """Print the exception of a callback with the frames outside of taskrpc."""
    found = traceback.TracebackException.from_exception(error)
    own = [each for each in found.stack if not each.filename.startswith(OWN)]
    for each in own:
        each.filename = cell_name(each.filename)
    found.stack = traceback.StackSummary.from_list(own)
    text = "".join(found.format())
    print(
        f"{text}The node continues. Correct the callback, and run its cell again.",
        file=sys.stderr,
        flush=True,
    )
