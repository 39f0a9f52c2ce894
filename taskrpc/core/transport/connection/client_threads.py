"""Calls from threads: the calling thread sends the request, and may read the response too.

If the event loop sent the request, waking it would cost more than the call. So the calling thread
writes to the socket itself if no other output is pending, under a lock that the event loop
takes too. The event loop reads the response and wakes the thread directly.

To wake two threads costs half of a call. So after some calls in a row that were alone on the
connection, the event loop stops reading from it, and the thread of a call reads its response. The
thread handles a read that completes its call and holds nothing else. It leaves any other read to
the event loop, which reads again from then on. It also reads again if a response takes long, if it
writes itself, and if threads make no more calls. So anything else that the server sends is read
at most 20 ms late.
"""

from __future__ import annotations

import asyncio
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from taskrpc.core.transport.base import OnDone
from taskrpc.core.transport.connection.client_side import CallingConnection, OpenCall, time_left
from taskrpc.core.transport.connection.connection import Owner
from taskrpc.core.transport.connection.threads import READ_TIMEOUT, ThreadSocket
from taskrpc.core.wire.frames import LARGE, NO_DEADLINE, Body
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.messages import Resolve
from taskrpc.core.wire.session import LAST_CALL_ID, Session

LEND_AFTER = 32
"""Calls in a row that were alone on the connection before threads read their responses."""
LEND_CHECK = 0.01
"""Seconds: the event loop reads again if no call began between two of these checks."""
_ENOUGH_TIME = 3 * READ_TIMEOUT
"""Milliseconds. If a call has less time left, its thread does not read: while it waits for bytes,
the event loop could not wake it at the deadline."""

_SLICE = 0.1
"""Seconds of one wait on a lock: on Windows, Ctrl-C interrupts a wait only at its end."""


class Waiter:
    """The future of an `OpenCall` for which a thread waits."""

    __slots__ = ("_cancelled", "_done", "_error", "_result", "_sleep", "call")

    call: OpenCall

    def __init__(self) -> None:
        self._sleep = threading.Lock()
        """Locked until the call ends; the waiting thread acquires it."""
        self._sleep.acquire()
        self._done = False
        self._cancelled = False
        self._result: Any = None
        self._error: BaseException | None = None

    def done(self) -> bool:
        """Whether the call has ended for its caller."""
        return self._done

    def cancelled(self) -> bool:
        """Whether the waiting thread was interrupted."""
        return self._cancelled

    def cancel(self) -> None:
        """Cancel the call; its response is dropped."""
        self._done = self._cancelled = True
        self.call.connection.owner.loop.call_soon_threadsafe(self.call.cancel)

    def set_result(self, result: Any) -> None:
        """Wake the thread with a response."""
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
        """Sleep until the call has ended; returns the response or raises the error."""
        try:
            if sys.platform == "win32":
                while not self._done and not self._sleep.acquire(timeout=_SLICE):
                    pass
            elif not self._done:  # otherwise this thread has read the response
                self._sleep.acquire()
        except BaseException:  # Ctrl-C
            self.cancel()
            raise
        if self._error is not None:
            raise self._error
        return self._result


class CallbackWaiter:
    """The future of an `OpenCall` with a function to call at its end.

    `on_done(response, error)` is called once, on the event loop's thread; one of the two is None.
    """

    __slots__ = ("_cancelled", "_done", "_on_done", "call")

    call: OpenCall | None
    """None once the call has ended: a reference cycle would delay freeing it."""

    def __init__(self, on_done: OnDone) -> None:
        self._on_done = on_done
        self._done = False
        self._cancelled = False

    def done(self) -> bool:
        """Whether the call has ended for its caller."""
        return self._done

    def cancelled(self) -> bool:
        """Whether the caller cancelled the call."""
        return self._cancelled

    def cancel(self) -> None:
        """Cancel the call; its response is dropped."""
        call = self.call
        if not self._done and call is not None:
            self._done = self._cancelled = True
            call.connection.owner.loop.call_soon_threadsafe(call.cancel)

    def set_result(self, result: Any) -> None:
        """Report the response."""
        if not self._done:
            self._done = True
            self.call = None
            self._on_done(result, None)

    def set_exception(self, error: BaseException) -> None:
        """Report an error."""
        if not self._done:
            self._done = True
            self.call = None
            self._on_done(None, error)


class ThreadedConnection(CallingConnection):
    """A calling connection that other threads than the event loop's may use."""

    __slots__ = ("_calls_alone", "_lent", "_lock", "_reader", "_thread_socket", "_unhandled")

    writes_at_once = False
    resumes_at_once = False  # a caller that continues must not hold the lock

    def __init__(self, owner: Owner, me: Identity, on_advertised: Callable[[], object]) -> None:
        self._thread_socket = ThreadSocket()
        self._lock = self._thread_socket.lock
        """The lock for the session and for writing."""
        self._calls_alone = 0
        """The calls in a row that were alone on the connection, while the event loop reads."""
        self._lent: asyncio.TimerHandle | None = None
        """The next check whether threads still call; None while the event loop reads."""
        self._reader: OpenCall | None = None
        """The call whose thread may read now; a thread reads under the lock only."""
        self._unhandled: list[bytes] = []
        """What a thread has read and left to the event loop."""
        super().__init__(owner, me, on_advertised)

    def call_in_thread(self, call: OpenCall, left: int = 0) -> bool:
        """Do as `begin_in_thread`; read the response too if the event loop has stopped reading."""
        found: list[tuple[OpenCall, Body]] = []
        try:
            if not self.begin_in_thread(call, left, may_read=True):
                return False
            if self._reader is not call:
                return True
            self._thread_socket.wait()
            found = self._completed(call)
        except BaseException:  # Ctrl-C
            call.future.cancel()
            raise
        finally:
            if self._reader is call:
                self.owner.loop.call_soon_threadsafe(self._return_reading, call)
        for ended, body in found:
            ended.answered(body)
        return True

    def begin_in_thread(self, call: OpenCall, left: int = 0, *, may_read: bool = False) -> bool:
        """Send a call from the calling thread; False if only the event loop can begin it.

        `left` as in `begin`. If the thread `may_read`, and the event loop does not, the call is
        `_reader` afterwards.
        """
        # Does the same as `begin`, but writes to the socket itself; a test compares both.
        session, deadline, size = self.session, call.deadline, len(call.body)
        with self._lock:
            if deadline is None:
                left = NO_DEADLINE
            elif not left:
                left = time_left(deadline, time.monotonic())
            if left <= 0 or not self._is_free(size):
                return False
            is_alone = not session.open_calls
            frame = session.request_frame(call, call.method, call.body, left, call.flags, size)
            if not frame:
                return False
            call.call_id = session.last_call_id
            if call.call_id >= LAST_CALL_ID:
                self.epoch += 1
            is_alone = is_alone and may_read and left > _ENOUGH_TIME
            if self._lent is None:
                self._calls_alone = self._calls_alone + 1 if is_alone else 0
            elif self._reader is None:
                if is_alone:
                    self._reader = call
                else:
                    self.owner.loop.call_soon_threadsafe(self._take_back)
            self._thread_socket.write(self, frame)
        if deadline is not None and deadline < self.check_before:
            self.owner.loop.call_soon_threadsafe(self.watch, deadline)
        return True

    def _completed(self, call: OpenCall) -> list[tuple[OpenCall, Body]]:
        """Read, and take the response to the call if it is the only one.

        If there is anything else to do, the call stays the `_reader`: its thread must return the
        reading to the event loop.
        """
        session, pieces = self.session, self._unhandled
        with self._lock:
            if self._reader is not call:
                return []
            self._thread_socket.read(pieces)
            if not pieces or len(session.open_calls) != 1:
                return []
            size = len(pieces[0])
            found, rest = session.responses(pieces[0], size)
            pieces[0] = rest
            self._watch.received += size - len(rest)
            if not (rest or session.open_calls or session.out or self._waiting or self._retired):
                pieces.clear()
                self._reader = None
            return found

    # Called on the event loop

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin: asyncio has connected the transport."""
        self._thread_socket.open(transport)
        super().connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """End: the transport is closed."""
        with self._lock:
            if self._lent is not None:
                self._read_again()
            self._thread_socket.close()
            super().connection_lost(exc)

    def buffer_updated(self, nbytes: int) -> None:
        """Handle bytes that asyncio has read into the buffer."""
        with self._lock:
            super().buffer_updated(nbytes)
            if self._calls_alone >= LEND_AFTER:
                self._lend()

    def begin(self, call: OpenCall, left: int = 0) -> None:
        """Send a call, or queue it."""
        with self._lock:
            super().begin(call, left)

    def resolve(
        self, question: Resolve, deadline: float | None, *, definition: bool = False
    ) -> OpenCall:
        """Ask for a service, or for a listing."""
        with self._lock:
            return super().resolve(question, deadline, definition=definition)

    def say(self, action: Callable[[Session], object]) -> None:
        """Let `action` send frames other than those of a call."""
        with self._lock:
            super().say(action)

    def forget(self, call: OpenCall, *, await_outcome: bool = False) -> None:
        """Cancel a call; with `await_outcome`, the server's answer still reaches it."""
        with self._lock:
            super().forget(call, await_outcome=await_outcome)

    def resume_writing(self) -> None:
        """Send the queued calls: the server has read what was written."""
        with self._lock:
            super().resume_writing()

    def expiring(self) -> Iterable[OpenCall]:
        """The calls that wait for a response, and those that wait to be sent."""
        with self._lock:
            return super().expiring()

    def tick(self, now: float) -> None:
        """Check for silent and stalled peers."""
        with self._lock:
            super().tick(now)

    def flush(self) -> None:
        """Write the session's output, after the rest of a thread's write."""
        direct = self._thread_socket
        with self._lock:
            writes = self.session.out or not direct.is_whole or not direct.is_idle
            if writes and self._lent is not None:
                self._take_back()
            if not direct.is_whole:
                direct.write_rest(self.transport)
            super().flush()
            if writes and (transport := self.transport) is not None:
                direct.is_idle = not transport.get_write_buffer_size()

    def _lend(self) -> None:
        """Stop reading, so that threads read the responses to their calls."""
        self._calls_alone = 0
        session, transport = self.session, self.transport
        if session.open_calls or session.mid_frame or self.link is not None or self._retired:
            return
        if transport is None or transport.is_closing() or not self.is_open:
            return
        if self._is_free(0) and self._thread_socket.open_for_reads():
            transport.pause_reading()
            self._check_lending(-1)

    def _check_lending(self, last_call_id: int) -> None:
        """Read again if threads began no call since the last check.

        A thread that has waited for so long is about to return the reading, or it cannot: a signal
        handler that interrupted it may wait for another call.
        """
        with self._lock:
            newest = self.session.last_call_id
            self._lent = self.owner.loop.call_later(LEND_CHECK, self._check_lending, newest)
            if newest == last_call_id:
                self._read_again()

    def _take_back(self) -> None:
        """Read again, unless a thread reads: it will return the reading."""
        with self._lock:
            if self._reader is None and self._lent is not None:
                self._read_again()

    def _return_reading(self, call: OpenCall) -> None:
        """Read again in the place of this call's thread."""
        with self._lock:
            if self._reader is call:
                self._read_again()

    def _read_again(self) -> None:
        """Read again, after the bytes that a thread has read and left."""
        if self._lent is not None:
            self._lent.cancel()
        self._lent = self._reader = None
        transport, data = self.transport, b"".join(self._unhandled)
        self._unhandled.clear()
        if transport is not None and not transport.is_closing():
            transport.resume_reading()
        self.get_buffer(-1)[: len(data)] = data
        self.buffer_updated(len(data))

    def _is_free(self, size: int) -> bool:
        """Whether a request may be written now: no other output is pending."""
        return (
            self._thread_socket.is_free
            and self.transport is not None
            and size < LARGE
            and size <= self.session.body_limit
            and not self.owner.behind
            and not self._writing_paused
            and not self._waiting
            and not self.session.out
        )
