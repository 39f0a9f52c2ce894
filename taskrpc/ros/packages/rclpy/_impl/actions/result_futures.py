"""The results of the goals of an action server, and the requests that wait for them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from ...executors import Executor
from ...service import RequestHeader
from ...task import Future, set_executor


class ResultFutures:
    """One future for each goal; a request for a result is answered when the future is done.

    While a cancellation is being answered, the result of its goal waits: in ROS, clients get the
    response to the cancellation first. The methods may be called from any thread.

    Arguments:
        send: receives the response and the header of a request that waited for it.
    """

    def __init__(self, send: Callable[[Any, RequestHeader], object]) -> None:
        self._send = send
        self._lock = threading.Lock()
        self._futures: dict[bytes, Future[Any]] = {}
        self._waiting: dict[RequestHeader, None] = {}
        """The requests for results of goals that have not ended."""
        self._held: dict[bytes, list[Any]] = {}
        """The goals whose cancellation is being answered; a list has the result if it waits."""

    def add(self, key: bytes) -> None:
        """Add a goal that was accepted."""
        self._futures[key] = Future()

    def forget(self, key: bytes) -> None:
        """Forget the goal and its result."""
        self._futures.pop(key, None)

    def request(self, key: bytes, header: RequestHeader, executor: Executor | None) -> bool:
        """Answer a request as soon as there is a result; False if the goal is unknown."""
        future = self._futures.get(key)
        if future is None:
            return False
        if executor is not None:
            set_executor(future, executor)
        self._waiting[header] = None
        future.add_done_callback(lambda done: self._answer(header, done))
        return True

    def _answer(self, header: RequestHeader, future: Future[Any]) -> None:
        self._waiting.pop(header, None)
        self._send(future.result(), header)

    def is_open(self, key: bytes) -> bool:
        """Whether a goal is known and has no result."""
        future = self._futures.get(key)
        with self._lock:
            has_waiting_result = bool(self._held.get(key))
        return future is not None and not future.done() and not has_waiting_result

    def complete(self, key: bytes, response: Any) -> None:
        """Set the result of a goal, or let it wait for the response to a cancellation."""
        with self._lock:
            if key in self._held:
                self._held[key].append(response)
                return
        if (future := self._futures.get(key)) is not None:
            future.set_result(response)

    def hold(self, key: bytes) -> bool:
        """Let the result of a goal wait until `release`; False if it does so already."""
        with self._lock:
            if key in self._held:
                return False
            self._held[key] = []
            return True

    def release(self, key: bytes) -> None:
        """Set the result that waited, if there is one."""
        with self._lock:
            waited = self._held.pop(key)
        for response in waited:
            self.complete(key, response)

    def take_waiting(self) -> list[RequestHeader]:
        """Take the requests that wait for results, which will not be answered any more."""
        found = list(self._waiting)
        self._waiting.clear()
        return found
