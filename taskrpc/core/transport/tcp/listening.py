"""Accepts connections at a socket, even during floods and without free file descriptors.

asyncio's own servers are not enough. Without a free descriptor they stop for a second and log a
traceback for each connection of the backlog. They also run any number of TLS handshakes at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
import ssl
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from taskrpc.core.security.tls import reason_of
from taskrpc.core.transport.connection.connection import HANDSHAKE_TIMEOUT, shown
from taskrpc.core.transport.limits.log_throttling import LimitedLog, ThrottledLog
from taskrpc.core.transport.limits.quotas import HostQueues, host_of
from taskrpc.core.transport.network import Factory

log = logging.getLogger("taskrpc.transport")

BACKLOG = 512
"""Connections that the kernel holds until they are accepted."""
MAX_ARRIVING = 128
"""Connections that are being established, TLS handshake included. One more closes the oldest one of
the machine that has the most."""
MAX_WAITING = 512
"""Accepted connections that wait for their turn. One more closes the oldest one of the machine that
has the most, unless that is this machine."""
ACCEPTS_A_TURN = 16
"""Connections accepted from the kernel in one turn of the loop; one of them begins."""

_PAUSE = 0.1
"""Seconds until the next attempt after the kernel could not accept a connection."""

_EXHAUSTED = {
    getattr(errno, name, errno.EMFILE)
    for name in ("EMFILE", "ENFILE", "ENOBUFS", "ENOMEM", "WSAEMFILE", "WSAENOBUFS")
}


class _Accepted(msgspec.Struct, frozen=True, eq=False):
    """An accepted connection that waits for its turn."""

    sock: socket.socket
    peer: Any
    host: str


class Listener:
    """Accepts the connections to a bound, listening socket; `factory` creates their protocols.

    `context` is called for each connection, because certificates may change. It returns None for a
    plain connection.
    """

    def __init__(
        self,
        sock: socket.socket,
        factory: Factory,
        context: Callable[[], ssl.SSLContext | None] = lambda: None,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._factory = factory
        self._context = context
        self._reserve: socket.socket | None = _spare()
        """Holds a descriptor for `_close_waiting`, when all others are in use."""
        self._waiting = HostQueues[_Accepted]()
        """Accepted connections that wait for their turn."""
        self._arriving = HostQueues[asyncio.Task[None]]()
        """The tasks that establish connections."""
        self._closing = False
        self._exhausted_log = ThrottledLog(log)
        self._arriving_log = ThrottledLog(log)
        self._waiting_log = ThrottledLog(log)
        self._refusals = LimitedLog(log)
        self._accepting = self._loop.create_task(self._accept())
        self._accepting.add_done_callback(self._stopped)

    async def close(self) -> None:
        """Accept no more connections, and cancel those that are being established."""
        self._closing = True
        if not _shut_down(self._sock):
            self._accepting.cancel()
        for task in self._arriving:
            task.cancel()
        await asyncio.wait((self._accepting, *self._arriving))

    def _stopped(self, _: object) -> None:
        self._sock.close()
        for accepted in self._waiting:
            accepted.sock.close()
        if self._reserve is not None:
            self._reserve.close()

    async def _accept(self) -> None:
        while not self._closing:
            try:
                if not self._waiting:
                    self._wait(*await self._loop.sock_accept(self._sock))
            except OSError as error:
                if error.errno == errno.EINVAL:
                    return  # `close` has shut the socket down
                if error.errno in _EXHAUSTED:
                    self._close_waiting(error)
                await asyncio.sleep(_PAUSE)
            else:
                self._accept_more()
                self._begin(self._waiting.pop_next())
                # One in each turn: a flood of connections must not delay the existing ones.
                await asyncio.sleep(0)

    def _wait(self, sock: socket.socket, peer: Any) -> None:
        accepted = _Accepted(sock, peer, host_of(peer))
        self._waiting.add(accepted.host, accepted)

    def _accept_more(self) -> None:
        """Accept more connections, because the kernel drops new ones while its queue is full.

        So a flood from one machine evicts only connections of that machine. Connections of this
        machine are never evicted: if they are the most, new ones wait in the kernel's queue.
        """
        for _ in range(ACCEPTS_A_TURN):
            is_full = len(self._waiting) >= MAX_WAITING
            evicted_host = self._waiting.largest() if is_full else ""
            if is_full and not evicted_host:
                return
            try:
                self._wait(*self._sock.accept())
            except OSError:
                return  # no connection waits; the next `sock_accept` reports any other error
            if is_full:
                self._close_oldest(evicted_host)

    def _close_oldest(self, host: str) -> None:
        self._waiting.pop_oldest(host).sock.close()
        text = "more than %d connections wait; the oldest of %s was closed"
        self._waiting_log.warning(self._loop.time(), text, MAX_WAITING, host)

    def _begin(self, accepted: _Accepted) -> None:
        if len(self._arriving) >= MAX_ARRIVING:
            self._arriving.pop_oldest(self._arriving.largest()).cancel()
            self._arriving_log.warning(
                self._loop.time(),
                "more than %d connections are being established; the oldest was closed",
                MAX_ARRIVING,
            )
        task = self._loop.create_task(self._connect(accepted.sock, accepted.peer))
        self._arriving.add(accepted.host, task)
        task.add_done_callback(partial(self._arrived, accepted))

    async def _connect(self, sock: socket.socket, peer: Any) -> None:
        context = self._context()
        sock.setblocking(False)
        try:
            await self._loop.connect_accepted_socket(
                self._factory,
                sock,
                ssl=context,
                ssl_handshake_timeout=HANDSHAKE_TIMEOUT if context else None,
            )
        except ssl.SSLError as error:
            problem = reason_of(error)
            text = "closed the connection from %s: no TLS: %s"
            self._refusals.warning(self._loop.time(), text, shown(peer), problem)
        except OSError as error:
            sock.close()  # there may be no transport yet to close it
            log.debug("the connection from %s was not established: %s", shown(peer), error)
        except Exception:
            sock.close()
            log.exception("the connection from %s failed:", shown(peer))

    def _arrived(self, accepted: _Accepted, task: asyncio.Task[None]) -> None:
        self._arriving.remove(accepted.host, task)
        if task.cancelled():
            accepted.sock.close()  # no transport may own it yet

    def _close_waiting(self, error: OSError) -> None:
        """Close all connections in the kernel's queue, so that their callers need not wait.

        Accepting needs a descriptor; this uses the one in reserve.
        """
        count = 0
        if self._reserve is not None:
            self._reserve.close()
        with contextlib.suppress(OSError):  # the queue is empty
            while count < BACKLOG:
                self._sock.accept()[0].close()
                count += 1
        self._reserve = _spare()
        self._exhausted_log.warning(
            self._loop.time(),
            "no descriptors are left for connections (%s); closed %d connections",
            error.strerror,
            count,
        )


def _shut_down(sock: socket.socket) -> bool:
    """Shut a listening socket down, which ends `sock_accept`; False if the system cannot.

    Cancelling `sock_accept` instead could lose a connection that it has just accepted.
    """
    if sock.family not in (socket.AF_INET, socket.AF_INET6):
        return False  # a Unix socket may stay readable for ever after a shutdown
    try:
        sock.shutdown(socket.SHUT_RDWR)
    except OSError:
        return False
    return True


def _spare() -> socket.socket | None:
    try:
        return socket.socket()
    except OSError:
        return None
