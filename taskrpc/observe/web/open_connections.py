"""Decides which connections of the web server stay open, and which are closed for new ones.

A browser sends its request right after it connects. A connection without a request only uses up
memory. So if there are too many connections, the oldest ones whose request is unfinished are
closed. A new connection stays open for a moment, because many pages may connect at one instant.
Event streams and WebSockets do not count: they have limits of their own.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Protocol

MAX_CONNECTIONS = 64
"""Most connections whose request is unfinished for longer than `TIME_TO_ASK`."""
TIME_TO_ASK = 2.0
"""Seconds for which a new connection stays open although its request is unfinished."""
MAX_UNFINISHED = 192
"""Most connections whose request is unfinished, new ones included."""
MAX_ANSWERED = 128
"""Most requests whose responses are being made at the same time."""


class Connection(Protocol):
    """A connection that counts."""

    def make_room(self) -> None:
        """Close at once, because there are too many connections."""


class TooManyRequests(Exception):
    """`MAX_ANSWERED` responses are being made."""


class OpenConnections:
    """The limited set of a server's connections."""

    def __init__(self) -> None:
        self._unfinished: dict[Connection, float] = {}
        """When each connection with an unfinished request arrived, in order of arrival."""
        self._answered: set[Connection] = set()
        """Connections whose response is being made."""

    def __len__(self) -> int:
        return len(self._unfinished) + len(self._answered)

    def add(self, connection: Connection, now: float) -> None:
        """Add a connection; if there are too many, close the oldest with an unfinished request.

        `now` is in seconds on any clock.
        """
        self._unfinished[connection] = now
        while self._is_full(now):
            oldest = next(iter(self._unfinished))
            del self._unfinished[oldest]
            oldest.make_room()

    def remove(self, connection: Connection) -> None:
        """Remove a connection that has ended, or that stays open for long."""
        self._unfinished.pop(connection, None)
        self._answered.discard(connection)

    @contextlib.contextmanager
    def kept(self, connection: Connection, now: float) -> Iterator[None]:
        """Protect a connection from being closed for another one inside the block.

        Raises TooManyRequests.
        """
        if len(self._answered) >= MAX_ANSWERED:
            raise TooManyRequests
        is_open = self._unfinished.pop(connection, None) is not None
        if is_open:
            self._answered.add(connection)
        try:
            yield
        finally:
            if connection in self._answered:
                self._answered.discard(connection)
                self._unfinished[connection] = now  # until the client has read the response

    def _is_full(self, now: float) -> bool:
        count = len(self._unfinished)
        if count <= MAX_CONNECTIONS:
            return False
        arrived = next(iter(self._unfinished.values()))
        return count > MAX_UNFINISHED or now - arrived >= TIME_TO_ASK
