"""One coarse timer wheel for all deadlines: never early, at most one tick late, O(1) to forget."""

from __future__ import annotations

import heapq
import math
from typing import Generic, TypeVar

Item = TypeVar("Item")

TICK = 0.005
"""Seconds between two turns of the wheel."""


class DeadlineWheel(Generic[Item]):
    """Items by the tick in which they expire; the caller brings the clock.

    A timer a call costs a third of the call; a dictionary entry costs next to nothing, and a
    forgotten one keeps nothing alive.
    """

    def __init__(self, tick: float = TICK) -> None:
        self._tick = tick
        self._slots: dict[int, dict[Item, None]] = {}
        self._order: list[int] = []

    def __len__(self) -> int:
        return sum(len(items) for items in self._slots.values())

    def add(self, deadline: float, item: Item) -> int:
        """Remember an item until `deadline` (an instant of the caller's clock, in seconds).

        Returns the slot, which `discard` wants back.
        """
        slot = math.ceil(deadline / self._tick)
        items = self._slots.get(slot)
        if items is None:
            self._slots[slot] = {item: None}
            heapq.heappush(self._order, slot)
        else:
            items[item] = None
        return slot

    def discard(self, slot: int, item: Item) -> None:
        """Forget an item before its deadline; unknown items are no error."""
        items = self._slots.get(slot)
        if items is not None:
            items.pop(item, None)

    def next_due(self) -> float | None:
        """The instant at which `expire` has something to do, or None."""
        while self._order and not self._slots[self._order[0]]:
            del self._slots[heapq.heappop(self._order)]
        return self._order[0] * self._tick if self._order else None

    def expire(self, now: float) -> list[Item]:
        """Take out every item whose deadline has passed, the earliest first."""
        expired: list[Item] = []
        # The clock may stand a rounding error before the slot that woke us.
        while self._order and self._order[0] * self._tick <= now + 1e-9:
            expired += self._slots.pop(heapq.heappop(self._order))
        return expired
