"""The way by which other threads than the event loop's write to a connection's socket."""

from __future__ import annotations

import asyncio
import socket
import threading

from taskrpc.transport.connection import Connection


class ThreadSocket:
    """Shared by the loop and the threads: whoever writes holds the `lock`.

    A connection has one, opens it where threads shall write, and closes it with the transport.
    """

    __slots__ = ("_socket", "is_whole", "lock")

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.is_whole = True
        """Whether all that threads have begun to write is written: nothing may come between."""
        self._socket: socket.socket | None = None

    @property
    def is_open(self) -> bool:
        """Whether threads can write: over TLS and in memory they cannot."""
        return self._socket is not None

    def open(self, transport: asyncio.BaseTransport) -> None:
        """Let threads write where this transport does, if they can."""
        found = transport.get_extra_info("socket")
        if found is not None and transport.get_extra_info("sslcontext") is None:
            self._socket = found.dup()

    def close(self) -> None:
        """The transport is gone."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def write(self, connection: Connection, data: bytes) -> None:
        """Write from this thread, which holds the lock; the loop writes what does not fit."""
        assert self._socket is not None
        connection.count_written(len(data))
        sent = 0
        try:
            sent = self._socket.send(data)
        except BlockingIOError:
            pass
        except OSError:
            return  # the loop is about to learn that the connection is gone
        if sent < len(data):
            self.is_whole = False
            loop = connection.owner.loop
            loop.call_soon_threadsafe(self._write_rest, connection, data[sent:])

    def _write_rest(self, connection: Connection, rest: bytes) -> None:
        with self.lock:
            self.is_whole = True
            if connection.transport is not None:
                connection.transport.write(rest)
            connection.flush()
