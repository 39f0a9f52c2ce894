"""Requests on their way to a server: at once where it is known, else when it is found."""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import time
import weakref
from collections import deque
from collections.abc import Callable
from functools import cache, partial
from typing import Any

from taskrpc.errors import ServiceUnavailable, WouldDeadlock
from taskrpc.transport.codec import codec_of

from ..bridge import NativeClient
from ..diagnostics.explain import like_ros

Tell = Callable[[Any, BaseException | None], object]
"""Is told of a call's end, on the loop's thread: the response or the error, one of them None."""

_PATIENCE = 2.0
"""Seconds that a program's end waits for requests whose server is known, and not reached yet."""


_A_MOMENT = 0.001


_DISCOVERY = 0.2
"""Like ROS: seconds to find the server in, else the request is lost."""


class Request:
    """One request that waits for its server."""

    def __init__(self, message: Any, tell: Tell) -> None:
        self.message = message
        self.tell = tell
        self.given_up = False
        self.future: asyncio.Future[Any] | None = None


class Outbox:
    """What a client has to send, in order."""

    def __init__(self, native: NativeClient, srv_type: Any) -> None:
        self._native = native
        self._codec = codec_of(srv_type.Request)
        self._waiting: deque[Request] = deque()
        self._untold: set[Request] = set()
        """What was not sent by the program's own thread, and has no answer: till then nothing is,
        since answers to that are told sooner, and would overtake."""
        self._sending: asyncio.Task[None] | None = None
        self._closed = False
        _outboxes.add(self)
        _heed_the_end()

    def send(self, message: Any, tell: Tell) -> Callable[[], object]:
        """Send a request, now or once its server is found; returns what gives it up.

        Raises InvalidRequest for one that cannot be sent.
        """
        if not self._untold and self._native.connected:
            return self._native.call_then(message, partial(self._ended, message, tell), None)
        if like_ros() and not self._native.wait(_DISCOVERY):
            return lambda: None
        # What the program does to the message afterwards must not change the request.
        message = self._codec.decode(self._codec.encode(message))
        request = self._queue(message, tell)  # here, lest the thread's next request overtakes it
        self._native.bridge.soon(self._begin)
        return lambda: self._native.bridge.soon(lambda: self._give_up(request))

    def _queue(self, message: Any, tell: Tell) -> Request:
        request = Request(message, partial(self._ended, message, tell))
        self._untold.add(request)
        self._waiting.append(request)
        return request

    @property
    def waits(self) -> bool:
        """Whether something is there that its server was not found for."""
        return bool(self._waiting)

    def close(self) -> None:
        """Let what waits go, where its server is there; then send nothing more."""
        self.let_go()
        self._closed = True
        self._waiting.clear()

    def let_go(self) -> None:
        """Wait a moment for what can still be sent."""
        end = time.monotonic() + _PATIENCE
        with contextlib.suppress(WouldDeadlock):
            self._native.bridge.do(lambda: None)  # what was handed over is in the queue now
            while self._waiting and self._native.is_known() and time.monotonic() < end:
                time.sleep(_A_MOMENT)
            self._native.bridge.do(lambda: None)  # and what was in the queue is written

    # On the loop

    def _ended(self, message: Any, tell: Tell, response: Any, error: BaseException | None) -> None:
        lost = self._closed or like_ros()
        if isinstance(error, ServiceUnavailable) and not lost:  # it certainly did not run
            self._queue(message, tell)
            self._begin()
        else:
            tell(response, error)

    def _begin(self) -> None:
        if self._sending is None or self._sending.done():
            task = self._sending = asyncio.get_running_loop().create_task(self._send_all())
            _tasks.add(task)  # the loop itself would let it vanish
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
        request = self._waiting[0]  # it stays there until it is sent: nothing may overtake it
        try:
            if request.given_up:
                self._untold.discard(request)
            else:
                request.future = future = self._native.inner.call_async(request.message, None)
                future.add_done_callback(partial(self._told, request))
        finally:
            self._waiting.popleft()

    def _told(self, request: Request, done: asyncio.Future[Any]) -> None:
        self._untold.discard(request)
        if not done.cancelled():
            error = done.exception()
            request.tell(None if error is not None else done.result(), error)

    def _give_up(self, request: Request) -> None:
        request.given_up = True
        if request.future is not None:
            request.future.cancel()


_outboxes: weakref.WeakSet[Outbox] = weakref.WeakSet()


@cache
def _heed_the_end() -> None:
    # Not at the import: what is registered later is called earlier, and the loop must still run.
    atexit.register(_let_go)


def _let_go() -> None:
    """A program that ends right after `call_async` has still called."""
    for outbox in list(_outboxes):
        outbox.let_go()


_tasks: set[asyncio.Task[None]] = set()
