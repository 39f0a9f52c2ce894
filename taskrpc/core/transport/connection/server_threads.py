"""Responses from handler threads, which those threads write themselves.

Waking the event loop to write would cost as much as a small call. So the thread removes the call
from the session and writes the response itself, if no other output is pending. Only the event loop
uses the session in any other way.
"""

from __future__ import annotations

import time

from taskrpc.core.transport.connection.incoming_call import RemoteCall
from taskrpc.core.transport.connection.server_side import ServerContext, ServingConnection
from taskrpc.core.transport.connection.threads import ThreadSocket
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.frames import LARGE
from taskrpc.core.wire.handshake import Identity


class ThreadedServing(ServingConnection):
    """A serving connection whose handlers may run in other threads."""

    __slots__ = ("_freed", "_open_tried", "_thread_socket")

    def __init__(self, host: ServerContext, me: Identity) -> None:
        self._thread_socket = ThreadSocket()
        self._open_tried = False
        """Whether the socket was opened for threads, with success or not."""
        self._freed: list[int] = []
        """Sizes of requests that threads answered; the session still counts them as in flight."""
        super().__init__(host, me)

    def answer_in_thread(self, call: RemoteCall, body: bytes) -> bool:
        """Answer a call from another thread; False where only the event loop can."""
        session, now = self.session, self.server.now
        if now is not time.monotonic or len(body) >= LARGE or len(body) > session.body_limit:
            return False
        with self._thread_socket.lock:
            if not self._is_free():
                return False
            spent = int((now() - call.arrived) * 1e6 + 0.5)
            answer = session.pop_response(call.call_id, body, spent)
            if answer is not None:
                frame, size = answer
                # Before the caller gets the response: its next request may need the room.
                self._freed.append(size)
                self._thread_socket.write(self, frame)
        if self._draining:  # it may have been the last response
            self.owner.loop.call_soon_threadsafe(self.flush)
        return True

    def _is_free(self) -> bool:
        """Whether a response may be written now: no other output is pending or incomplete."""
        direct, transport = self._thread_socket, self.transport
        if transport is None or self._draining or not direct.is_whole:
            return False
        if (
            self.owner.behind or self.session.out
        ):  # responses must not overtake this; checked in this order
            return False
        if not self._open_tried:  # most connections never need a second descriptor
            self._open_tried = True
            direct.open(transport)
        return direct.is_open and direct.is_idle and self.session.state is ConnectionState.OPEN

    # Called on the event loop

    def buffer_updated(self, nbytes: int) -> None:
        """Handle bytes that asyncio has read into the buffer."""
        self._settle()
        super().buffer_updated(nbytes)

    def tick(self, now: float) -> None:
        """Check for silent and stalled peers."""
        self._settle()
        super().tick(now)

    def flush(self) -> None:
        """Write the session's output, after the rest of a thread's write."""
        direct = self._thread_socket
        with self._thread_socket.lock:
            writes = self.session.out or not direct.is_whole or not direct.is_idle
            if not direct.is_whole:
                direct.write_rest(self.transport)
            super().flush()
            if writes and (transport := self.transport) is not None:
                direct.is_idle = not transport.get_write_buffer_size()

    def connection_lost(self, exc: Exception | None) -> None:
        """End: the transport is closed."""
        with self._thread_socket.lock:
            self._thread_socket.close()
            super().connection_lost(exc)

    def _settle(self) -> None:
        while self._freed:
            self.session.freed(self._freed.pop())
