"""The clock by which leases end: it goes on from server to server, and never leaps.

The time of day does. A machine without a clock of its own wakes up in another year and is put
right a minute later; by the time of day that would end every lease, and what is repeated then
would run again.
"""

from __future__ import annotations

from collections.abc import Iterable

from taskrpc.wire.ledger import LEASE
from taskrpc.wire.once import Completion

DOWN_AT_MOST = LEASE / 2
"""Seconds that count at most of the time for which no server ran: nobody can tell it from a leap of
the clock, and no leap alone may end a lease."""


class LeaseClock:
    """Tells an instant by seconds, about those since 1970.

    It goes on behind the newest of a store's completions, then as another clock does that shows
    `ticks` now.
    """

    def __init__(self, completions: Iterable[Completion], wall: float, ticks: float) -> None:
        newest = max(completions, key=lambda each: each.at, default=None)
        start = wall
        if newest is not None:
            down = wall - (newest.wall or newest.at)
            start = newest.at + min(max(0.0, down), DOWN_AT_MOST)
        self.offset = start - ticks
        """To be added to what the other clock shows."""
