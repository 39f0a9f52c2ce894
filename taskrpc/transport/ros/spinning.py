"""rclpy's executor in a thread, and the end of what rclpy has created."""

from __future__ import annotations

import atexit
import contextlib
import logging
import threading
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Any

log = logging.getLogger("taskrpc.transport")

_SEND_TIMEOUT = 1.0
"""Seconds to wait until the subscriptions have the last messages of a publisher."""
_EXIT_TIMEOUT = 8.0
"""Seconds for which the exit of Python waits until everything has ended."""
_JOIN_TIMEOUT = 2.0
"""Seconds to wait for the end of a thread: a real rclpy may hang."""


class Ending:
    """Destroys objects of rclpy in a thread, one by one, because each may take a second."""

    def __init__(self) -> None:
        self._actions: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        # A daemon, because a real rclpy may hang. At its end, Python waits for it with a limit, so
        # that the last messages are sent.
        self._thread = threading.Thread(target=self._run, name="taskrpc ROS end", daemon=True)

    def put(self, action: Callable[..., object], *arguments: Any) -> None:
        """Call an action in the thread; errors of rclpy while it ends are ignored."""
        self._actions.put(partial(action, *arguments))
        if self._thread.ident is None:  # it has not begun
            self._thread.start()
            atexit.register(self._finish)

    def close(self) -> None:
        """Accept no more actions; those that are there still run."""
        self._actions.put(None)

    def _run(self) -> None:
        while (action := self._actions.get()) is not None:
            with contextlib.suppress(Exception):
                action()
        atexit.unregister(self._finish)

    def _finish(self) -> None:
        self.close()
        self._thread.join(_EXIT_TIMEOUT)


def wait_until_sent(ros: Any, publisher: Any) -> None:
    """Wait until all subscriptions have the messages of a reliable publisher, a second at most."""
    with contextlib.suppress(Exception):  # the context may be over
        publisher.wait_for_all_acked(ros.duration.Duration(seconds=_SEND_TIMEOUT))


class Spinner:
    """An executor of rclpy that runs in a thread of its own."""

    def __init__(self, ros: Any, context: Any, name: str) -> None:
        self._executor = ros.executors.SingleThreadedExecutor(context=context)
        self._context = context
        # A daemon: a program whose event loop has ended must not wait for ROS.
        self._thread = threading.Thread(target=self._spin, name=f"taskrpc {name}", daemon=True)
        self._is_closed = False

    def add(self, node: Any) -> None:
        """Run the callbacks of a node."""
        self._executor.add_node(node)
        if not self._thread.is_alive() and not self._is_closed:
            self._thread.start()

    def remove(self, node: Any) -> None:
        """Stop running the callbacks of a node."""
        self._executor.remove_node(node)

    def close(self) -> None:
        """End the thread; call it from another one, because it may block for seconds."""
        self._is_closed = True
        self._executor.shutdown(timeout_sec=_JOIN_TIMEOUT)
        if self._thread.is_alive():
            self._thread.join(_JOIN_TIMEOUT)

    def _spin(self) -> None:
        while not self._is_closed and self._context.ok():
            try:
                self._executor.spin_once(timeout_sec=1.0)
            except Exception as error:
                if self._is_closed or not self._context.ok():
                    return
                # For example a message of a damaged program; the others must go on.
                log.error("a callback of ROS 2 failed: %s: %s", type(error).__name__, error)
