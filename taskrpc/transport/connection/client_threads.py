"""Calls from other threads than the event loop's: sent by the caller itself, answered by the loop.

Waking the loop to send for us, and going to sleep while it does, costs more than the call. So the
caller's thread writes to the socket where nothing else waits to be written, under a lock that the
loop takes too; only the answer comes by the loop, which wakes the caller directly.
"""

from __future__ import annotations

import asyncio
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from taskrpc.transport.base import Tell
from taskrpc.transport.connection.client_side import CallingConnection, OpenCall, time_left
from taskrpc.transport.connection.connection import Owner
from taskrpc.transport.connection.threads import ThreadSocket
from taskrpc.wire.frames import LARGE, NO_DEADLINE
from taskrpc.wire.handshake import Identity
from taskrpc.wire.messages import Resolve
from taskrpc.wire.session import LAST_CALL_ID, Session

_SLICE = 0.1
"""Seconds of one wait on a lock: on Windows Ctrl-C does not reach a longer one before its end."""


class Waiter:
    """What an `OpenCall` has instead of a future, where a thread waits for the answer."""

    __slots__ = ("_cancelled", "_done", "_error", "_result", "_sleep", "call")

    call: OpenCall

    def __init__(self) -> None:
        self._sleep = threading.Lock()
        self._sleep.acquire()
        self._done = False
        self._cancelled = False
        self._result: Any = None
        self._error: BaseException | None = None

    def done(self) -> bool:
        """Whether nobody waits any more."""
        return self._done

    def cancelled(self) -> bool:
        """Whether the waiting thread gave up."""
        return self._cancelled

    def give_up(self) -> None:
        """Drop the answer; the server is told that nobody waits."""
        self._done = self._cancelled = True
        self.call.connection.owner.loop.call_soon_threadsafe(self.call.give_up)

    def set_result(self, result: Any) -> None:
        """Wake the thread with an answer."""
        if not self._done:
            self._result = result
            self._done = True
            self._sleep.release()

    def set_exception(self, error: BaseException) -> None:
        """Wake the thread with an error."""
        self._error = error
        self._done = True
        self._sleep.release()

    def wait(self) -> Any:
        """Sleep until there is an answer; returns it, or raises the error."""
        try:
            if sys.platform == "win32":
                while not self._sleep.acquire(timeout=_SLICE):
                    pass
            else:
                self._sleep.acquire()
        except BaseException:  # Ctrl-C
            self.give_up()
            raise
        if self._error is not None:
            raise self._error
        return self._result


class CallbackWaiter:
    """What an `OpenCall` has instead of a future, where a function is to be told of the answer.

    `tell(answer, error)` is called once, on the event loop's thread; one of the two is None.
    """

    __slots__ = ("_cancelled", "_done", "_tell", "call")

    call: OpenCall | None
    """Until it has ended: it knows us, and no cycle shall be left of a call."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._done = False
        self._cancelled = False

    def done(self) -> bool:
        """Whether nobody waits any more."""
        return self._done

    def cancelled(self) -> bool:
        """Whether the caller gave up."""
        return self._cancelled

    def give_up(self) -> None:
        """Drop the answer; the server is told that nobody waits."""
        call = self.call
        if not self._done and call is not None:
            self._done = self._cancelled = True
            call.connection.owner.loop.call_soon_threadsafe(call.give_up)

    def set_result(self, result: Any) -> None:
        """Tell of an answer."""
        if not self._done:
            self._done = True
            self.call = None
            self._tell(result, None)

    def set_exception(self, error: BaseException) -> None:
        """Tell of an error."""
        if not self._done:
            self._done = True
            self.call = None
            self._tell(None, error)


class ThreadedConnection(CallingConnection):
    """A calling connection of an event loop whose nodes are used by other threads."""

    __slots__ = ("_here", "_mine")

    def __init__(self, owner: Owner, me: Identity, on_advertised: Callable[[], object]) -> None:
        self._here = ThreadSocket()
        self._mine = self._here.lock
        """Held by whoever touches the session, or writes."""
        super().__init__(owner, me, on_advertised)

    def begin_in_thread(self, call: OpenCall) -> bool:
        """Send a call from the caller's thread; False where only the loop can begin it."""
        session, deadline = self.session, call.deadline
        with self._mine:
            left = NO_DEADLINE if deadline is None else time_left(deadline, time.monotonic())
            if left <= 0 or not self._is_free(len(call.body)):
                return False
            call.call_id = session.request(call, call.method, call.body, left)
            if not call.call_id:
                return False
            if call.call_id >= LAST_CALL_ID:
                self.epoch += 1
            self._here.write(self, b"".join(session.take()))
        if deadline is not None and deadline < self.look_before:
            self.owner.loop.call_soon_threadsafe(self.watch, deadline)
        return True

    # The loop's own ways to the session and to the socket

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The transport is there."""
        self._here.open(transport)
        super().connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """The transport is gone."""
        with self._mine:
            self._here.close()
            super().connection_lost(exc)

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes were read."""
        with self._mine:
            super().buffer_updated(nbytes)

    def begin(self, call: OpenCall) -> None:
        """Send a call, or queue it."""
        with self._mine:
            super().begin(call)

    def resolve(
        self, question: Resolve, deadline: float | None, *, definition: bool = False
    ) -> OpenCall:
        """Ask for a service, or for a listing."""
        with self._mine:
            return super().resolve(question, deadline, definition=definition)

    def say(self, action: Callable[[Session], object]) -> None:
        """Let something else than a call go out."""
        with self._mine:
            super().say(action)

    def forget(self, call: OpenCall, *, but_hear: bool = False) -> None:
        """A caller gave up; with `but_hear` the server's answer still reaches the call."""
        with self._mine:
            super().forget(call, but_hear=but_hear)

    def resume_writing(self) -> None:
        """The server has caught up."""
        with self._mine:
            super().resume_writing()

    def expiring(self) -> Iterable[OpenCall]:
        """The calls that wait for an answer, and those that wait to be sent."""
        with self._mine:
            return super().expiring()

    def tick(self, now: float) -> None:
        """Look after the connection."""
        with self._mine:
            super().tick(now)

    def flush(self) -> None:
        """Write what the session has to say, behind the rest of what a thread began to write."""
        here = self._here
        with self._mine:
            writes = self.session.out or not here.is_whole or not here.is_idle
            if not here.is_whole:
                here.write_rest(self.transport)
            super().flush()
            if writes and (transport := self.transport) is not None:
                here.is_idle = not transport.get_write_buffer_size()

    def _is_free(self, size: int) -> bool:
        """Whether a request may be written here and now: nothing waits to go before it."""
        session, here = self.session, self._here
        return (
            here.is_open
            and self.transport is not None
            and size < LARGE
            and size <= session.body_limit
            and here.is_whole
            and here.is_idle
            and not self.owner.behind
            and not self.holds_back
            and not session.out
        )
