"""The asyncio transport of one end of a tunnelled connection."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from taskrpc.core.transport.pipe import HIGH_WATER, LOW_WATER, ReadingEnd
from taskrpc.core.transport.tunnel.frames import Datagram
from taskrpc.core.transport.tunnel.stream import State, Stream


class StreamTransport(ReadingEnd):
    """Joins a stream, its protocol, and the engine that sends the datagrams.

    `address` is the other end's program. `on_lost(transport)` is called once, when the connection
    has ended.
    """

    def __init__(
        self,
        protocol: asyncio.BufferedProtocol,
        address: str,
        stream: Stream,
        send: Callable[[str, bytes], None],
        on_lost: Callable[[StreamTransport], object],
    ) -> None:
        super().__init__(protocol, address)
        self.address = address
        self.stream = stream
        self._send = send
        self._on_lost = on_lost
        self._writing_paused = False

    def write(self, data: Any) -> None:
        """Send bytes; those that the other end is not ready for wait here."""
        if self._closing:
            return
        self.stream.write(data)
        self._send_out()
        if self.stream.waiting_size > HIGH_WATER and not self._writing_paused:
            self._writing_paused = True
            self._protocol.pause_writing()

    def get_write_buffer_size(self) -> int:
        """Return the number of bytes that wait here."""
        return self.stream.waiting_size

    def close(self) -> None:
        """End the connection after the bytes that were written."""
        if not self._closing:
            self._closing = True
            self.stream.close()
            self._send_out()
            self._end_if_finished()

    def abort(self) -> None:
        """End the connection at once."""
        self._closing = True
        self.stream.reset("the other end has aborted the connection")
        self._send_out()
        self._loop.call_soon(self._lose)

    def vanish(self) -> None:
        """End the connection at once, and send nothing to the other end, which is gone."""
        self._closing = True
        self._loop.call_soon(self._lose)

    def feed(self, datagram: Datagram) -> None:
        """Handle a datagram that arrived for this connection."""
        stream = self.stream
        data = stream.feed(datagram)
        if data and not self._lost and not self._closing:
            self._inbox.append(data)
            self._inbox_size += len(data)
            if self._reading:
                self._deliver()  # not in a later turn: that would cost each call another turn
        if stream.out:
            self._send_out()
        if stream.state is State.RESET:
            self._reset()
        elif stream.ended and not self._ended:
            self._end()
        if self._writing_paused and stream.waiting_size < LOW_WATER:
            self._writing_paused = False
            if not self._lost:
                self._protocol.resume_writing()
        if self._closing:
            self._end_if_finished()

    def _deliver(self) -> None:
        unread = self._inbox_size
        super()._deliver()
        if (read := unread - self._inbox_size) and not self._lost:
            self.stream.read(read)
            if self.stream.out:
                self._send_out()

    def _send_out(self) -> None:
        out, self.stream.out = self.stream.out, []
        for datagram in out:
            self._send(self.address, datagram)

    def _end_if_finished(self) -> None:
        if self.stream.state is not State.CLOSING and not self._lost:
            self._loop.call_soon(self._lose)

    def _lose(self) -> None:
        if not self._lost:
            super()._lose()
            self._on_lost(self)
