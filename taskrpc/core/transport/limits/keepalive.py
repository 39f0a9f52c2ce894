"""When a silent peer counts as gone: keepalive settings, and the kernel's TCP timeouts.

Each system has its own socket options for this. Linux needs more: it also drops a peer whose
receive buffer is full because its program computes. `TcpTimeouts` tells the two apart.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import sys
from typing import NamedTuple

import msgspec

from taskrpc.errors import TaskRpcError


class Keepalive(NamedTuple):
    """When a connection probes a silent peer, and when it ends."""

    silence: float
    """Seconds without a byte after which the peer is probed."""
    dead_after: float
    """Seconds without an acknowledgement after which the kernel ends the connection."""


DEFAULT = Keepalive(silence=5.0, dead_after=8.0)
ROBOT = Keepalive(silence=1.0, dead_after=2.0)
"""For programs that drive a robot, and must notice a lost connection at once."""

PROFILES = {"default": DEFAULT, "robot": ROBOT}


def keepalive_of(name: str | None) -> Keepalive:
    """The profile of this name; without a name, that of `TASKRPC_KEEPALIVE`.

    Raises TaskRpcError for an unknown name.
    """
    where = "keepalive" if name else "TASKRPC_KEEPALIVE"
    wanted = name or os.environ.get("TASKRPC_KEEPALIVE") or "default"
    if wanted not in PROFILES:
        expected = " or ".join(PROFILES)
        raise TaskRpcError(f"{where}: expected {expected}, got {wanted!r}")
    return PROFILES[wanted]


_TCP_MAXRT = 5  # Windows: seconds of retransmission before the connection is dropped
_TCP_RXT_CONNDROPTIME = 0x80  # macOS: the same
_FIRST_REPETITION = 0.25
"""Seconds until the first retransmission; Linux counts its timeout from there."""
_INFO = "3xB20xI28xI84xI80xI"
"""The fields of Linux's tcp_info that `_Backlog` is made of."""
_INFO_SIZE = struct.calcsize(_INFO)
_UNANSWERED_PROBES = 2
"""Unanswered window probes that count as proof, since a single one may be lost."""


class TcpTimeouts:
    """Lets the kernel end a connection whose peer is dead, and no other.

    For a connection that has written something, after `drop_dead_peers`. It is not needed any
    more once `is_busy` is False: thousands of idle connections have none.
    """

    __slots__ = ("_is_spared", "_keepalive", "_sock", "is_busy")

    def __init__(self, sock: socket.socket, keepalive: Keepalive) -> None:
        self._sock = sock
        self._keepalive = keepalive
        self._is_spared = False
        self.is_busy = True
        """Whether bytes were unacknowledged at the last check."""

    def is_over(self) -> bool:
        """Whether a peer with a full receive buffer is dead; call this once a second."""
        backlog = _backlog_of(self._sock)
        if backlog is None:
            self.is_busy = False
            return False
        self.is_busy = backlog.is_there
        if backlog.waits_for_room is not self._is_spared:
            self._is_spared = backlog.waits_for_room
            _set_user_timeout(self._sock, 0.0 if self._is_spared else self._keepalive.dead_after)
        is_late = backlog.heard_ago >= self._keepalive.dead_after
        return self._is_spared and is_late and backlog.unanswered_probes >= _UNANSWERED_PROBES


def drop_dead_peers(sock: socket.socket, silence: float, seconds: float) -> bool:
    """Let the kernel end a connection whose peer has not acknowledged for `seconds`.

    After a `silence` of so many seconds it asks the peer's kernel once a second. Returns whether
    it does.
    """
    with contextlib.suppress(OSError):
        if sys.platform == "win32":
            # asyncio's proactor leaves Nagle's algorithm on where it accepts.
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        idle = "TCP_KEEPALIVE" if sys.platform == "darwin" else "TCP_KEEPIDLE"
        for name, value in (
            (idle, int(silence)),
            ("TCP_KEEPINTVL", 1),
            ("TCP_KEEPCNT", int(seconds - silence)),
        ):
            if hasattr(socket, name):
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
        if sys.platform == "win32":
            sock.setsockopt(socket.IPPROTO_TCP, _TCP_MAXRT, int(seconds))
        elif sys.platform == "darwin":
            sock.setsockopt(socket.IPPROTO_TCP, _TCP_RXT_CONNDROPTIME, int(seconds))
        else:
            _set_user_timeout(sock, seconds)
        return True
    return False


def _set_user_timeout(sock: socket.socket, seconds: float) -> None:
    """Set how long Linux waits for acknowledgement and buffer space; 0.0 for no limit."""
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        since_then = int(max(0.0, seconds - _FIRST_REPETITION) * 1000)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, since_then)


class _Backlog(msgspec.Struct):
    """Undelivered bytes of a socket, and when its peer was heard last."""

    is_there: bool
    waits_for_room: bool
    unanswered_probes: int
    """Window probes since the peer's last answer."""
    heard_ago: float
    """Seconds since the peer's last packet."""


def _backlog_of(sock: socket.socket) -> _Backlog | None:
    """The backlog of a socket; None on other systems, or if the socket is closed."""
    if sys.platform != "linux":
        return None
    else:  # mypy recognises another system only by such a branch
        try:
            found = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _INFO_SIZE)
            asked, unacknowledged, heard, unsent, room = struct.unpack(_INFO, found)
        # The socket has just been closed (uvloop raises ValueError), or Linux is older than 5.4.
        except (OSError, ValueError, struct.error):
            return None
        full = unsent > 0 and not (unacknowledged and room)
        return _Backlog(unacknowledged > 0 or unsent > 0, full, asked, heard / 1000)
