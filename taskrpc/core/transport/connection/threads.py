"""How threads work beside the event loop: ordered hand-off, and direct writes to a socket."""

from __future__ import annotations

import asyncio
import contextlib
import select
import socket
import sys
import threading
from collections.abc import Callable

from taskrpc.core.transport.connection.connection import READ_BUFFER, Connection

READ_TIMEOUT = 10
"""Milliseconds that a thread waits for bytes; then the event loop reads."""

_ONE_READ = (READ_BUFFER,)


class ThreadSocket:
    """A connection's socket, shared by the event loop and other threads; writers hold the `lock`.

    The connection opens it for threads, and closes it with the transport. If a thread could write
    only a part, the event loop writes the rest before anything else.
    """

    __slots__ = ("_poll", "_rest", "_socket", "is_idle", "lock")

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self._rest = b""
        """Bytes that a thread could not write."""
        self.is_idle = True
        """Whether the transport had written everything when the event loop last flushed.

        Threads must not read this from the transport: it writes its buffer without the lock, and
        already reports an empty buffer while it writes."""
        self._socket: socket.socket | None = None
        """A duplicate of the transport's socket."""
        self._poll: Callable[[int], object] | None = None
        """Waits for bytes, at most so many milliseconds; None before threads read."""

    @property
    def is_open(self) -> bool:
        """Whether threads can write at all: over TLS and in memory they cannot."""
        return self._socket is not None

    @property
    def is_free(self) -> bool:
        """Whether a thread can write now: nothing else is left to be written."""
        return self._socket is not None and not self._rest and self.is_idle

    @property
    def is_whole(self) -> bool:
        """Whether the last write of a thread is complete; until then, write no other output."""
        return not self._rest

    def open(self, transport: asyncio.BaseTransport) -> None:
        """Let threads write to the socket of this transport, if that is possible."""
        found = transport.get_extra_info("socket")
        if found is not None and transport.get_extra_info("sslcontext") is None:
            with contextlib.suppress(OSError):  # no descriptor is left; the event loop has its own
                self._socket = found.dup()

    def open_for_reads(self) -> bool:
        """Let threads read too; False if they cannot: on Windows, asyncio's read does not stop."""
        if sys.platform != "win32" and self._socket is not None:
            # A new one: a thread may still wait in the one before, which has no place for a second.
            poll = select.poll()
            poll.register(self._socket.fileno(), select.POLLIN)
            self._poll = poll.poll
            return True
        return False

    def close(self) -> None:
        """Close the socket, after the transport is gone."""
        self._rest = b""
        if self._socket is not None:
            if self._poll is not None:
                with contextlib.suppress(OSError):
                    self._socket.shutdown(socket.SHUT_RDWR)  # wakes a thread in `wait`
            self._socket.close()
            self._socket = None

    def wait(self) -> None:
        """Wait until bytes have arrived, the connection is gone, or `READ_TIMEOUT` is over."""
        assert self._poll is not None
        self._poll(READ_TIMEOUT)

    def read(self, pieces: list[bytes]) -> None:
        """Append what has arrived to `pieces`, and do not wait; the thread holds the lock.

        `pieces` has the bytes even if Ctrl-C interrupts the thread as soon as they were read.
        """
        assert self._socket is not None
        try:
            # Inside `extend`, no signal handler runs after `recv` has returned.
            pieces.extend(map(self._socket.recv, _ONE_READ))
        except OSError:  # usually nothing has arrived; the event loop finds any other error
            return

    def write(self, connection: Connection, data: bytes) -> None:
        """Write from this thread, which holds the lock; the event loop writes the rest."""
        assert self._socket is not None
        connection.count_written(len(data))
        sent = 0
        try:
            sent = self._socket.send(data)
        except ConnectionError:
            return  # the event loop is about to notice that the connection is gone
        except OSError:
            pass  # the socket buffer is full; the event loop finds any other error
        if sent < len(data):
            self._rest = data[sent:]
            connection.owner.loop.call_soon_threadsafe(connection.flush)

    def write_rest(self, transport: asyncio.WriteTransport | None) -> None:
        """Write the rest of a thread's data; the event loop calls this and holds the lock."""
        rest, self._rest = self._rest, b""
        if transport is not None:
            transport.write(rest)


class ThreadHandoff:
    """Ordered hand-off of actions from other threads to the event loop."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.behind: list[None] = []
        """One item for each pending action."""

    def hand_over(self, action: Callable[[], object]) -> None:
        """Run an action on the event loop; threads send nothing directly while it is pending."""
        self.behind.append(None)
        self.loop.call_soon_threadsafe(self._run, action)

    def _run(self, action: Callable[[], object]) -> None:
        try:
            action()
        finally:
            self.behind.pop()
