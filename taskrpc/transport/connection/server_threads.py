"""Answers from other threads than the event loop's, written by those threads themselves.

Waking the loop to write for us costs as much as a small call. The thread takes the call out of the
session, and writes the answer beside what the session has to say, where nothing is half written;
all else of the session stays the loop's.
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
    """A serving connection of an event loop whose services are answered by other threads."""

    __slots__ = ("_freed", "_here", "_was_asked")

    def __init__(self, host: ServerContext, me: Identity) -> None:
        self._here = ThreadSocket()
        self._was_asked = False
        self._freed: list[int] = []
        """Sizes of requests that threads have answered, of which the session is yet to learn."""
        super().__init__(host, me)

    def answer_in_thread(self, call: RemoteCall, body: bytes) -> bool:
        """Answer a call from another thread than the loop's; False where only the loop can."""
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
                # Before the caller can know: his next request may need the room.
                self._freed.append(size)
                self._here.write(self, frame)
        if self._draining:  # perhaps it was the last answer
            self.owner.loop.call_soon_threadsafe(self.flush)
        return True

    def _is_free(self) -> bool:
        """Whether an answer may be written here and now: nothing is half written."""
        here, transport = self._here, self.transport
        if transport is None or self._draining or not here.is_whole:
            return False
        if self.owner.behind or self.session.out:  # which this would overtake; asked in this order
            return False
        if not self._was_asked:  # most connections never are, and need no descriptor more
            self._was_asked = True
            here.open(transport)
        return here.is_open and here.is_idle and self.session.state is ConnectionState.OPEN

    # The loop's own ways to the session and to the socket

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes were read."""
        self._settle()
        super().buffer_updated(nbytes)

    def handled(self) -> None:
        """All events of a read have been handled."""
        self.flush()

    def tick(self, now: float) -> None:
        """Look after the connection."""
        self._settle()
        super().tick(now)

    def flush(self) -> None:
        """Write what the session has to say, behind the rest of what a thread began to write."""
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
