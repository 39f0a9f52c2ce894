"""One coarse timer wheel for all deadlines: never early, at most one tick late, O(1) to forget."""

from __future__ import annotations

import heapq
import math
from typing import Generic, TypeVar

Item = TypeVar("Item")

TICK = 0.005
"""Seconds between two turns of the wheel."""

_RESOLUTION = 1e-9  # an event loop's clock may stand so far before the instant that it woke for
_EMPTY_KEPT = 1024


class DeadlineWheel(Generic[Item]):
    """Items by the tick in which they expire; the caller brings the clock.

    A timer a call costs a third of the call; a dictionary entry costs next to nothing, and a
    forgotten one keeps nothing alive.
    """

    def __init__(self, tick: float = TICK) -> None:
        self._tick = tick
        self._slots: dict[int, dict[Item, None]] = {}
        self._order: list[int] = []
        self._empty = 0

    def __len__(self) -> int:
        return sum(map(len, self._slots.values()))

    def add(self, deadline: float, item: Item) -> int:
        """Remember an item until `deadline` (a finite instant of the caller's clock, in seconds).

        Returns the slot, which `discard` wants back.
        """
        slot = math.ceil(deadline / self._tick)
        items = self._slots.get(slot)
        if items is None:
            self._slots[slot] = {item: None}
            heapq.heappush(self._order, slot)
        else:
            if not items:
                self._empty -= 1
            items[item] = None
        return slot

    def discard(self, slot: int, item: Item) -> None:
        """Forget an item before its deadline; unknown items are no error."""
        items = self._slots.get(slot)
        if not items or item not in items:
            return
        del items[item]
        if not items:
            # Kept for the next call of the same tick, but not without end.
            self._empty += 1
            if self._empty > _EMPTY_KEPT and 2 * self._empty > len(self._slots):
                self._drop_empty()

    def next_due(self) -> float | None:
        """The instant at which `expire` has something to do, or None."""
        while self._order and not self._slots[self._order[0]]:
            self._take_first()
        return self._order[0] * self._tick if self._order else None

    def expire(self, now: float) -> list[Item]:
        """Take out every item whose deadline has passed, the earliest tick first."""
        expired: list[Item] = []
        while self._order and self._order[0] * self._tick <= now + _RESOLUTION:
            expired += self._take_first()
        return expired

    def _take_first(self) -> dict[Item, None]:
        items = self._slots.pop(heapq.heappop(self._order))
        self._empty -= not items
        return items

    def _drop_empty(self) -> None:
        self._slots = {slot: items for slot, items in self._slots.items() if items}
        self._order = sorted(self._slots)
        self._empty = 0
