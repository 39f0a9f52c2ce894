"""The way by which other threads than the event loop's write to a connection's socket."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable

from taskrpc.transport.connection.connection import Connection


class ThreadSocket:
    """Shared by the loop and the threads: whoever writes holds the `lock`.

    A connection has one, opens it where threads shall write, has the loop write the rest before all
    else, and closes it with the transport.
    """

    __slots__ = ("_rest", "_socket", "is_idle", "lock")

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self._rest = b""
        self.is_idle = True
        """Whether the transport had written everything when the loop last flushed.

        Threads must not ask the transport itself: it writes what is left in its buffer without the
        lock, and calls the buffer empty while it does."""
        self._socket: socket.socket | None = None

    @property
    def is_open(self) -> bool:
        """Whether threads can write: over TLS and in memory they cannot."""
        return self._socket is not None

    @property
    def is_whole(self) -> bool:
        """Whether all that threads have begun to write is written: nothing may come between."""
        return not self._rest

    def open(self, transport: asyncio.BaseTransport) -> None:
        """Let threads write where this transport does, if they can."""
        found = transport.get_extra_info("socket")
        if found is not None and transport.get_extra_info("sslcontext") is None:
            with contextlib.suppress(OSError):  # no descriptor is left: the loop needs none
                self._socket = found.dup()

    def close(self) -> None:
        """The transport is gone."""
        self._rest = b""
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
        except ConnectionError:
            return  # the loop is about to learn that the connection is gone
        except OSError:
            pass  # the system has no room; what else it may be, the loop finds out
        if sent < len(data):
            self._rest = data[sent:]
            connection.owner.loop.call_soon_threadsafe(connection.flush)

    def write_rest(self, transport: asyncio.WriteTransport | None) -> None:
        """Write what did not fit; by the loop, which holds the lock, too."""
        rest, self._rest = self._rest, b""
        if transport is not None:
            transport.write(rest)


class ThreadHandoff:
    """The part of an endpoint that other threads hand their work to, in order."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.behind: list[None] = []
        """One for each thing that was handed over and is not done yet."""

    def hand_over(self, action: Callable[[], object]) -> None:
        """Have the loop do something that another thread wants, which nothing shall overtake."""
        self.behind.append(None)
        self.loop.call_soon_threadsafe(self._take_over, action)

    def _take_over(self, action: Callable[[], object]) -> None:
        try:
            action()
        finally:
            self.behind.pop()
