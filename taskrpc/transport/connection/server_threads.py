"""Responses from handler threads, which those threads write themselves.

Waking the event loop to write costs as much as a small call. The thread takes the call out of the
session and writes the response itself, if no other output is pending. Only the event loop does
anything else with the session.
"""

from __future__ import annotations

import time

from taskrpc.transport.connection.incoming_call import RemoteCall
from taskrpc.transport.connection.server_side import ServerContext, ServingConnection
from taskrpc.transport.connection.threads import ThreadSocket
from taskrpc.wire.connection_state import ConnectionState
from taskrpc.wire.frames import LARGE
from taskrpc.wire.handshake import Identity


class ThreadedServing(ServingConnection):
    """A serving connection whose handlers may run in other threads."""

    __slots__ = ("_freed", "_here", "_was_asked")

    def __init__(self, host: ServerContext, me: Identity) -> None:
        self._here = ThreadSocket()
        self._was_asked = False
        self._freed: list[int] = []
        """Sizes of requests that threads have answered and the session does not know yet."""
        super().__init__(host, me)

    def answer_in_thread(self, call: RemoteCall, body: bytes) -> bool:
        """Answer a call from another thread; False where only the event loop can."""
        session, now = self.session, self.server.now
        if now is not time.monotonic or len(body) >= LARGE or len(body) > session.body_limit:
            return False
        with self._here.lock:
            if not self._is_free():
                return False
            spent = int((now() - call.arrived) * 1e6 + 0.5)
            answer = session.answer_beside(call.call_id, body, spent)
            if answer is not None:
                frame, size = answer
                # Before the caller gets the response: its next request may need the room.
                self._freed.append(size)
                self._here.write(self, frame)
        if self._draining:  # it may have been the last response
            self.owner.loop.call_soon_threadsafe(self.flush)
        return True

    def _is_free(self) -> bool:
        """Whether a response may be written now: no other output is pending or incomplete."""
        here, transport = self._here, self.transport
        if transport is None or self._draining or not here.is_whole:
            return False
        if (
            self.owner.behind or self.session.out
        ):  # responses must not overtake this; checked in this order
            return False
        if not self._was_asked:  # most connections never need a second descriptor
            self._was_asked = True
            here.open(transport)
        return here.is_open and here.is_idle and self.session.state is ConnectionState.OPEN

    # Called on the event loop

    def buffer_updated(self, nbytes: int) -> None:
        """Handle bytes that asyncio has read into the buffer."""
        self._settle()
        super().buffer_updated(nbytes)

    def handled(self) -> None:
        """Write the output, after all events of a read."""
        self.flush()

    def tick(self, now: float) -> None:
        """Check for silent and stalled peers."""
        self._settle()
        super().tick(now)

    def flush(self) -> None:
        """Write the session's output, after the rest of a thread's write."""
        here = self._here
        with self._here.lock:
            writes = self.session.out or not here.is_whole or not here.is_idle
            if not here.is_whole:
                here.write_rest(self.transport)
            super().flush()
            if writes and (transport := self.transport) is not None:
                here.is_idle = not transport.get_write_buffer_size()

    def connection_lost(self, exc: Exception | None) -> None:
        """The transport is gone."""
        with self._here.lock:
            self._here.close()
            super().connection_lost(exc)

    def _settle(self) -> None:
        while self._freed:
            self.session.freed(self._freed.pop())
