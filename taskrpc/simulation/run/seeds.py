"""Which seeds to run: new ones, and variants of those that went another way than all before; pure.

A seed has two parts: what happens (faults, delays, starts) follows from `seed % VARIANT`, and the
order of the threads from the whole. So `seed + n * VARIANT` has the same faults in another order.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Final

VARIANT: Final = 10**9

_EVERY = 4  # one of so many runs is a variant of an earlier one
_KEPT = 1000


class Seeds:
    """Gives out seeds.

    Args:
        first: the first seed.
        count: how many seeds it gives; None: without end.
    """

    def __init__(self, first: int, count: int | None) -> None:
        self._next = first
        self._left = count
        self._given = 0
        self._shapes: set[int] = set()
        self._novel: deque[int] = deque(maxlen=_KEPT)
        """Seeds whose runs went another way than all before."""

    @property
    def found(self) -> int:
        """How many different ways runs went."""
        return len(self._shapes)

    def take(self, count: int) -> list[int]:
        """Return the next seeds; [] when all are given."""
        if self._left is not None:
            count = min(count, self._left)
            self._left -= count
        return [self._one() for _ in range(count)]

    def learn(self, shapes: Iterable[tuple[int, int]]) -> None:
        """Learn which way runs went."""
        for seed, shape in shapes:
            if shape not in self._shapes:
                self._shapes.add(shape)
                self._novel.append(seed)

    def _one(self) -> int:
        self._given += 1
        if self._given % _EVERY == 0 and self._novel:
            return self._novel.popleft() + VARIANT
        seed, self._next = self._next, self._next + 1
        return seed
