"""Connections inside one event loop: a pair of asyncio transports without a socket."""

from __future__ import annotations

import asyncio
from collections import deque
from contextvars import Context, copy_context
from typing import Any

HIGH_WATER, LOW_WATER = 65_536, 16_384
"""Unread bytes at which an end must pause writing, and at which it may resume."""


class ReadingEnd(asyncio.Transport):
    """The reading half of a transport whose bytes come from code of this process.

    Subclasses pass the bytes to `_receive`, and the end of the connection to `_end` or `_reset`.
    """

    def __init__(self, protocol: asyncio.BufferedProtocol, name: str) -> None:
        super().__init__({"peername": name})
        self._loop = asyncio.get_running_loop()
        self._context = copy_context()
        """The context in which this end reads, as with a socket: not that of the other end."""
        self._protocol = protocol
        self._inbox: deque[memoryview] = deque()
        """Bytes from the other end that the protocol has not read."""
        self._inbox_size = 0
        self._reading = True
        self._delivery_planned = False
        self._sender_waits = False
        """Whether `_wake_sender` must be called when most bytes are read."""
        self._closing = False
        """Whether this end was closed, by itself or after the other one."""
        self._lost = False
        """Whether the protocol knows that the connection is gone."""
        self._ended = False
        """Whether the other end was closed."""

    def is_closing(self) -> bool:
        """Whether this end was closed."""
        return self._closing

    def pause_reading(self) -> None:
        """Stop passing bytes to the protocol."""
        self._reading = False

    def resume_reading(self) -> None:
        """Continue to pass bytes to the protocol."""
        self._reading = True
        self._plan_delivery()

    def is_reading(self) -> bool:
        """Whether bytes are passed to the protocol."""
        return self._reading

    def _wake_sender(self) -> None:
        """Let the other end write again: most of its bytes are read."""
        raise NotImplementedError

    def _receive(self, data: bytes) -> None:
        if not self._lost:
            view = memoryview(data)
            self._inbox.append(view)
            self._inbox_size += view.nbytes
            if not self._delivery_planned:
                self._delivery_planned = True
                self._loop.call_soon(self._deliver, context=self._context)

    def _end(self) -> None:
        """Close this end once it has read all bytes: the other end was closed."""
        self._ended = True
        self._plan_delivery()

    def _reset(self) -> None:
        """Close this end without reading more: the other end was aborted."""
        self._inbox.clear()
        self._inbox_size = 0
        self._end()

    def _plan_delivery(self) -> None:
        if not self._delivery_planned:
            self._delivery_planned = True
            self._loop.call_soon(self._deliver, context=self._context)

    def _deliver(self) -> None:
        self._delivery_planned = False
        inbox, protocol = self._inbox, self._protocol
        while inbox and self._reading and not self._lost and not self._closing:
            room, data = memoryview(protocol.get_buffer(-1)), inbox.popleft()
            count = data.nbytes
            if count > room.nbytes:
                count = room.nbytes
                inbox.appendleft(data[count:])
                data = data[:count]
            room[:count] = data
            self._inbox_size -= count
            protocol.buffer_updated(count)
        if self._sender_waits and self._inbox_size < LOW_WATER:
            self._wake_sender()
        if self._ended and (not self._inbox or self._closing):
            self._closing = True
            self._lose()

    def _lose(self) -> None:
        if not self._lost:
            self._lost = True
            self._inbox.clear()
            self._inbox_size = 0
            self._protocol.connection_lost(None)


class Pipe(ReadingEnd):
    """One end of a connection in memory; the other end reads the bytes written here."""

    peer: Pipe

    def write(self, data: Any) -> None:
        """Send bytes to the other end, which reads them in the next turn of the loop."""
        if not self._closing and data:
            peer = self.peer
            peer._receive(bytes(data))
            if peer._inbox_size > HIGH_WATER and not peer._sender_waits:
                peer._sender_waits = True
                self._protocol.pause_writing()

    def get_write_buffer_size(self) -> int:
        """Return the number of bytes that the other end has not read."""
        return self.peer._inbox_size

    def close(self) -> None:
        """Close both ends once the other end has read all bytes."""
        if not self._closing:
            self._closing = True
            self.peer._end()
            self._loop.call_soon(self._lose)

    def abort(self) -> None:
        """Close both ends at once."""
        self._closing = True
        self.peer._reset()
        self._loop.call_soon(self._lose)

    def _wake_sender(self) -> None:
        peer = self.peer
        if not peer._lost:
            self._sender_waits = False
            peer._protocol.resume_writing()


def join(
    client: asyncio.BufferedProtocol,
    server: asyncio.BufferedProtocol,
    name: str,
    *,
    context: Context | None = None,
) -> tuple[Pipe, Pipe]:
    """Connect two protocols with each other; return both ends.

    `context`: that of the server's program, by default the present one.
    """
    one = Pipe(client, name)
    other = (context or copy_context()).run(Pipe, server, f"a client of {name}")
    one.peer, other.peer = other, one
    server.connection_made(other)
    client.connection_made(one)
    return one, other
