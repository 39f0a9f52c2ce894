"""Counts what became of an endpoint's connections, and what went over them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from taskrpc.transport.connection.connection import Connection

if TYPE_CHECKING:
    from taskrpc.observer import Connections


class Traffic:
    """One side's connections; those that are open count for themselves until they end."""

    __slots__ = ("_ended", "_opened", "_received", "_sent")

    def __init__(self) -> None:
        self._opened = self._received = self._sent = 0
        self._ended: dict[str, int] = {}

    def began(self) -> None:
        """A connection has its transport."""
        self._opened += 1

    def left(self, connection: Connection) -> None:
        """A connection is gone."""
        why = connection.why_closed
        reason = "" if why is None else type(why).__name__
        self._ended[reason] = self._ended.get(reason, 0) + 1
        self._received += connection.received
        self._sent += connection.written

    def counts(self, connections: Iterable[Connection]) -> Connections:
        """All counts, with those of the connections that are open."""
        from taskrpc.observer import Connections  # few programs ask

        now = list(connections)
        return Connections(
            self._opened,
            len(now),
            dict(self._ended),
            self._received + sum(each.received for each in now),
            self._sent + sum(each.written for each in now),
        )
