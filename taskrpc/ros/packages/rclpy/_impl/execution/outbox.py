"""The outbox of a client: sends requests at once, or when their server has been found."""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import time
import weakref
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from taskrpc.errors import ServiceUnavailable, WouldDeadlock
from taskrpc.spi import codec_of

from ..bridge import NativeClient
from ..diagnostics.explain import like_ros

OnResponse = Callable[[Any, BaseException | None], object]
"""Receives the response and the error of a call, one of which is None, on the loop's thread."""

_FLUSH_TIMEOUT = 2.0
"""Seconds that a program waits at its end for requests whose server is known but not connected."""


_POLL_INTERVAL = 0.001
"""Seconds between two checks of whether the outbox is empty."""

_DISCOVERY_TIMEOUT = 0.2
"""With `--like-ros`: seconds to find the server; after that, the request is lost."""


class Request:
    """A request that waits for its server."""

    def __init__(self, message: Any, on_response: OnResponse) -> None:
        self.message = message
        self.on_response = on_response
        self.is_cancelled = False
        self.future: asyncio.Future[Any] | None = None


class Outbox:
    """The requests of one client, in the order of the calls."""

    def __init__(self, native: NativeClient, srv_type: Any) -> None:
        self._native = native
        self._codec = codec_of(srv_type.Request)
        self._waiting: deque[Request] = deque()
        self._loop_sent: set[Request] = set()
        """Requests sent by the loop that have no response yet. While there is one, no request is
        sent directly: its response would overtake theirs."""
        self._sending: asyncio.Task[None] | None = None
        self._closed = False
        _outboxes[self] = None
        _register_flush()

    def send(self, message: Any, on_response: OnResponse) -> Callable[[], object]:
        """Send a request, now or once its server is found; returns a function that cancels it.

        Raises InvalidRequest for one that cannot be sent.
        """
        if not self._loop_sent and self._native.connected:
            return self._native.call_then(message, partial(self._ended, message, on_response), None)
        if like_ros() and not self._native.wait(_DISCOVERY_TIMEOUT):
            return lambda: None
        # The program may change the message afterwards; that must not change the request.
        message = self._codec.decode(self._codec.encode(message))
        # Queued on this thread: the next request of the thread must not overtake it.
        request = self._queue(message, on_response)
        self._native.bridge.soon(self._begin)
        return lambda: self._native.bridge.soon(lambda: self._cancel(request))

    def _queue(self, message: Any, on_response: OnResponse) -> Request:
        request = Request(message, partial(self._ended, message, on_response))
        self._loop_sent.add(request)
        self._waiting.append(request)
        return request

    @property
    def waits(self) -> bool:
        """Whether a request waits for its server."""
        return bool(self._waiting)

    def close(self) -> None:
        """Send the waiting requests if their server is known; then send nothing more."""
        self.flush()
        self._closed = True
        self._waiting.clear()

    def flush(self) -> None:
        """Wait up to two seconds for requests that can still be sent."""
        end = time.monotonic() + _FLUSH_TIMEOUT
        with contextlib.suppress(WouldDeadlock):
            self._native.bridge.do(lambda: None)  # earlier hand-offs have reached the queue now
            while self._waiting and self._native.is_known() and time.monotonic() < end:
                time.sleep(_POLL_INTERVAL)
            self._native.bridge.do(lambda: None)  # and the queue is written

    # On the loop

    def _ended(
        self, message: Any, on_response: OnResponse, response: Any, error: BaseException | None
    ) -> None:
        lost = self._closed or like_ros()
        if isinstance(error, ServiceUnavailable) and not lost:  # the request certainly did not run
            self._queue(message, on_response)
            self._begin()
        else:
            on_response(response, error)

    def _begin(self) -> None:
        if self._sending is None or self._sending.done():
            task = self._sending = asyncio.get_running_loop().create_task(self._send_all())
            _tasks.add(task)  # the loop keeps only a weak reference
            task.add_done_callback(_tasks.discard)

    async def _send_all(self) -> None:
        inner = self._native.inner
        while self._waiting:
            if not await inner.wait_for_service(None):
                return  # the client is destroyed
            with contextlib.suppress(IndexError):  # another thread closed it
                while self._native.connected:
                    self._send_first()

    def _send_first(self) -> None:
        request = self._waiting[0]  # it stays until it is sent: no other may overtake it
        try:
            if request.is_cancelled:
                self._loop_sent.discard(request)
            else:
                request.future = future = self._native.inner.call_async(request.message, None)
                future.add_done_callback(partial(self._finished, request))
        finally:
            self._waiting.popleft()

    def _finished(self, request: Request, done: asyncio.Future[Any]) -> None:
        self._loop_sent.discard(request)
        if not done.cancelled():
            error = done.exception()
            request.on_response(None if error is not None else done.result(), error)

    def _cancel(self, request: Request) -> None:
        request.is_cancelled = True
        if request.future is not None:
            request.future.cancel()


_outboxes: weakref.WeakKeyDictionary[Outbox, None] = weakref.WeakKeyDictionary()


_is_registered = False
"""Whether this program flushes at its end; `taskrpc.simulation` has one value for each program."""


def _register_flush() -> None:
    global _is_registered
    if not _is_registered:
        _is_registered = True
        # Not at import: exit functions run in reverse order, and this one needs the loop.
        atexit.register(_flush_all)


def _flush_all() -> None:
    """Send the last requests of a program that ends right after `call_async`."""
    for outbox in list(_outboxes):
        outbox.flush()


_tasks: set[asyncio.Task[None]] = set()
