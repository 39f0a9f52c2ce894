"""A bound on the unread bytes of responses over all connections.

Each connection begins no more calls while its caller does not read. But a thousand callers with one
large unread response each would still fill the memory. Above a bound, the services that send large
responses begin no calls until callers have read, or stalled callers are disconnected.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import asyncio

MAX_UNREAD = 32 * 1024 * 1024
"""Bytes of responses that all callers together may leave unread."""


class UnreadConnection(Protocol):
    """What backpressure needs from a connection."""

    @property
    def transport(self) -> asyncio.Transport | None:
        """Its asyncio transport, None once it is gone."""

    @property
    def written(self) -> int:
        """Bytes that were written to it."""

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """Its event loop."""

    def release(self) -> None:
        """Begin the calls that it holds back."""


class Backpressure:
    """Counts unread bytes of responses, and holds calls back while there are too many."""

    def __init__(self) -> None:
        self.is_active = False
        """Whether there are too many unread bytes."""
        self._total = 0
        self._sizes: dict[UnreadConnection, int] = {}
        self._answers: dict[UnreadConnection, deque[tuple[int, int]]] = {}
        """Where each large response begins and ends in the bytes that were written."""
        self._large: set[str] = set()
        """Services that have sent a large response."""
        self._waiting: dict[UnreadConnection, None] = {}
        """Connections that hold calls back, in order."""
        self._next: dict[UnreadConnection, None] = {}
        """Connections that may continue, one in each turn of the event loop."""

    def answered(self, service: str, connection: UnreadConnection, size: int) -> None:
        """Count a large response of so many bytes."""
        self._large.add(service)
        end = connection.written
        self._answers.setdefault(connection, deque()).append((end - size, end))
        self.measure(connection)

    def forbids(self, service: str) -> bool:
        """Whether the calls of a service may not begin now."""
        return self.is_active and service in self._large

    def hold(self, connection: UnreadConnection) -> None:
        """Remember a connection that holds a call back; `release` is called when there is room."""
        self._waiting[connection] = None

    def measure(self, connection: UnreadConnection) -> None:
        """Update the unread bytes of one connection."""
        transport = connection.transport
        size = 0 if transport is None else transport.get_write_buffer_size()
        if connection in self._answers:
            size += self._still_held(connection, size)
        self._total += size - self._sizes.pop(connection, 0)
        if size:
            self._sizes[connection] = size
        self._judge()

    def measure_all(self) -> None:
        """Update the unread bytes of all connections; call this about once a second."""
        for connection in list(self._sizes):
            self.measure(connection)

    def left(self, connection: UnreadConnection) -> None:
        """Forget a connection that is gone."""
        self._waiting.pop(connection, None)
        self._next.pop(connection, None)
        self._answers.pop(connection, None)
        self.measure(connection)

    def _still_held(self, connection: UnreadConnection, unread: int) -> int:
        """Sent bytes of a large response that asyncio still keeps in memory.

        Since Python 3.12 asyncio keeps a whole buffer until its last byte is sent, but
        `get_write_buffer_size` counts only the unsent part.
        """
        answers, sent = self._answers[connection], connection.written - unread
        while answers and answers[0][1] <= sent:
            answers.popleft()
        if not answers:
            del self._answers[connection]
            return 0
        return max(0, sent - answers[0][0])

    def _judge(self) -> None:
        if self._total > MAX_UNREAD:
            self.is_active = True
        elif self.is_active and not self._next and self._total <= MAX_UNREAD // 2:
            self._next, self._waiting = self._waiting, {}
            self._release()

    def _release(self) -> None:
        """Let one connection begin the calls that it holds back; the others follow in later turns.

        A thousand callers may have disconnected at once, and asyncio reports it only in later
        turns. Running all their calls now would delay every other caller.
        """
        self.is_active = self._total > MAX_UNREAD
        if self.is_active:
            self._waiting, self._next = self._next | self._waiting, {}
        elif self._next:
            connection = next(iter(self._next))
            del self._next[connection]
            connection.release()
            if not self._next:  # now the connections that came meanwhile
                self._next, self._waiting = self._waiting, {}
            if self._next:
                self.is_active = True  # new calls stay behind those that wait
                connection.loop.call_soon(self._release)
