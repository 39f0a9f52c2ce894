"""What callers have not read of their answers, over all connections: a bound on its memory.

A connection by itself begins no more calls while its caller does not read. A thousand such callers
with one large answer each are the endpoint's matter: above a bound, the services that give large
answers begin no calls for anybody until some are read, or those who read nothing are cut off.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import asyncio

MAX_UNREAD = 32 * 1024 * 1024
"""Bytes of answers that all callers together may leave unread."""


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
    """Counts the answers that wait to be read."""

    def __init__(self) -> None:
        self.is_active = False
        """Whether there are too many."""
        self._total = 0
        self._sizes: dict[UnreadConnection, int] = {}
        self._answers: dict[UnreadConnection, deque[tuple[int, int]]] = {}
        """Where the large answers begin and end in what was written."""
        self._large: set[str] = set()
        """Services that have given a large answer."""
        self._waiting: dict[UnreadConnection, None] = {}
        """Those that hold calls back, in order."""
        self._next: dict[UnreadConnection, None] = {}
        """Those of them that may go on, one a turn of the loop."""

    def answered(self, service: str, connection: UnreadConnection, size: int) -> None:
        """A service gave a large answer of so many bytes."""
        self._large.add(service)
        end = connection.written
        self._answers.setdefault(connection, deque()).append((end - size, end))
        self.measure(connection)

    def forbids(self, service: str) -> bool:
        """Whether a service's calls may not begin now."""
        return self.is_active and service in self._large

    def hold(self, connection: UnreadConnection) -> None:
        """A connection whose caller reads holds a call back; `release` it when there is room."""
        self._waiting[connection] = None

    def measure(self, connection: UnreadConnection) -> None:
        """Look how much one caller has not read."""
        transport = connection.transport
        size = 0 if transport is None else transport.get_write_buffer_size()
        if connection in self._answers:
            size += self._still_held(connection, size)
        self._total += size - self._sizes.pop(connection, 0)
        if size:
            self._sizes[connection] = size
        self._judge()

    def measure_all(self) -> None:
        """Look how much everybody has not read; about once a second is enough."""
        for connection in list(self._sizes):
            self.measure(connection)

    def left(self, connection: UnreadConnection) -> None:
        """A connection is gone."""
        self._waiting.pop(connection, None)
        self._next.pop(connection, None)
        self._answers.pop(connection, None)
        self.measure(connection)

    def _still_held(self, connection: UnreadConnection, unread: int) -> int:
        """The bytes of an answer that were sent, and are held until its last one is.

        Since Python 3.12 asyncio keeps all of what it was given, and counts only what is left.
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
        """Let one connection begin what it has held back, and others in the turns to come.

        A thousand callers may have gone at once. Were all their calls run before we hear of it,
        nobody else would be served meanwhile, and what is raised by each attempt to answer one
        would keep its answer.
        """
        self.is_active = self._total > MAX_UNREAD
        if self.is_active:
            self._waiting, self._next = self._next | self._waiting, {}
        elif self._next:
            connection = next(iter(self._next))
            del self._next[connection]
            connection.release()
            if not self._next:  # it is the turn of those who have come meanwhile
                self._next, self._waiting = self._waiting, {}
            if self._next:
                self.is_active = True  # what comes now stays behind what waits
                connection.loop.call_soon(self._release)
