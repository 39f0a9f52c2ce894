"""rclpy's executor in a thread, and the end of what rclpy has created."""

from __future__ import annotations

import atexit
import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Any

log = logging.getLogger("taskrpc.transport")

_SEND_TIMEOUT = 1.0
"""Seconds to wait until the subscriptions have the last messages of a publisher."""
_EXIT_TIMEOUT = 8.0
"""Seconds for which the exit of Python waits until everything has ended."""
_JOIN_TIMEOUT = 5.0
"""Seconds to wait for the end of a thread: a real rclpy may hang."""
_POLL = 0.01
"""Seconds between two looks whether a message has arrived."""


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
    now, end = ros.duration.Duration(seconds=0), time.monotonic() + _SEND_TIMEOUT
    with contextlib.suppress(Exception):  # the context may be over
        # rclpy keeps Python's lock while it waits: a longer wait would stop the whole program.
        while not publisher.wait_for_all_acked(now) and time.monotonic() < end:
            time.sleep(_POLL)


class Spinner:
    """An executor of rclpy that runs in a thread of its own.

    Only this thread destroys the nodes of its executor, and never while rclpy waits there: its wait
    set refers to all that the nodes have.
    """

    def __init__(self, ros: Any, context: Any, name: str) -> None:
        self._executor = ros.executors.SingleThreadedExecutor(context=context)
        self._context = context
        self._destroyed = ros.exceptions.InvalidHandle
        # A daemon, because a real rclpy may hang. But Python stops the daemons at its end, and a
        # thread that it stops inside rclpy aborts the process: so the end of Python closes this.
        self._thread = threading.Thread(target=self._run, name=f"taskrpc {name}", daemon=True)
        self._nodes: list[Any] = []
        self._actions: deque[Callable[[], object]] = deque()
        """What the thread does before it waits again."""
        self._woken = threading.Event()
        """Wakes the thread after the end of the context, when the executor does not wait."""
        self._is_closed = False

    def add(self, node: Any) -> None:
        """Run the callbacks of a node."""
        self._nodes.append(node)
        self._executor.add_node(node)
        if not self._thread.is_alive() and not self._is_closed:
            atexit.register(self.close)
            self._thread.start()

    def put(self, action: Callable[..., object], *arguments: Any) -> None:
        """Call an action in the thread, while rclpy does not wait there; errors are ignored.

        After `close`, nothing happens: the end of the node destroys all that it has.
        """
        if not self._is_closed:
            self._actions.append(partial(action, *arguments))
            self._wake()

    def remove(self, node: Any) -> None:
        """Destroy a node, in the thread."""
        self.put(self._remove, node)

    def close(self) -> bool:
        """Destroy the nodes and end the thread; False if the thread hangs, with its nodes.

        Call it from another thread, because it may block for seconds.
        """
        self._is_closed = True
        if self._thread.ident is None:  # it has not begun
            self._end()
            return True
        self._wake()
        self._thread.join(_JOIN_TIMEOUT)
        return not self._thread.is_alive()

    def _wake(self) -> None:
        self._woken.set()
        with contextlib.suppress(Exception):  # the context may be over
            # A mere `wake` lets rclpy wait again, without a return from `spin_once`.
            self._executor.create_task(_nothing)

    def _run(self) -> None:
        while True:
            self._woken.clear()
            while self._actions:
                with contextlib.suppress(Exception):  # such as InvalidHandle after the context
                    self._actions.popleft()()
            if self._is_closed:
                break
            if self._context.ok():
                self._spin_once()
            else:
                self._woken.wait()
        self._end()
        atexit.unregister(self.close)

    def _spin_once(self) -> None:
        try:
            self._executor.spin_once(timeout_sec=1.0)
        except self._destroyed:
            pass  # closed just before rclpy waited for it; the next turn leaves it out
        except Exception as error:
            if not self._is_closed and self._context.ok():
                # For example a message of a damaged program; the others must go on.
                log.error("a callback of ROS 2 failed: %s: %s", type(error).__name__, error)

    def _remove(self, node: Any) -> None:
        self._nodes.remove(node)
        self._executor.remove_node(node)
        node.destroy_node()

    def _end(self) -> None:
        """Destroy everything: first the executor, whose wait set refers to the nodes."""
        with contextlib.suppress(Exception):
            self._executor.shutdown(timeout_sec=0)
        while self._nodes:
            with contextlib.suppress(Exception):
                self._nodes.pop().destroy_node()


def _nothing() -> None: ...
