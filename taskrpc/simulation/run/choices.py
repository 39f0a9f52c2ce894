"""All chance of a run, drawn from its seed; pure.

Each decision has a name, such as `lose response 3 of /pick`, and its own random number. So leaving
out one fault does not change the others, which the search for a shorter story needs.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Sequence
from hashlib import blake2b
from typing import Protocol

from taskrpc.simulation.run.seeds import VARIANT


class Named(Protocol):
    """What may run next."""

    @property
    def ident(self) -> int:
        """Its number in the run."""


class Choices:
    """The decisions of one run.

    Args:
        seed: the same seed gives the same decisions.
        kept: the names of the faults that may happen; None: all.
        orderly: whether what was ready first runs first, instead of a random order.
    """

    def __init__(
        self, seed: int, kept: Collection[str] | None = None, *, orderly: bool = False
    ) -> None:
        self.seed = seed
        self._kept = None if kept is None else frozenset(kept)
        self._orderly = orderly
        # The other decisions follow from the seed without its variant; see `seeds`.
        self._order = random.Random(f"order {seed}")
        self._base = seed % VARIANT
        self._by_priority = self._order.random() < 0.5
        self._priorities: dict[int, float] = {}
        """Of the stacks, while the order follows priorities."""
        self._left = self._next_change()

    def chance(self, name: str) -> random.Random:
        """Return a generator of its own for a purpose."""
        return random.Random(int.from_bytes(self._digest(name)))

    def fraction(self, name: str) -> float:
        """Return a random number from 0 (included) to 1 (excluded) for a decision."""
        return (int.from_bytes(self._digest(name)) >> 11) * 2.0**-53

    def happens(self, fault: str, share: float) -> bool:
        """Return whether a fault happens."""
        if self._kept is not None and fault not in self._kept:
            return False
        return share > 0 and self.fraction(fault) < share

    def seconds(self, name: str, least: float, most: float) -> float:
        """Return how long something takes."""
        return least + (most - least) * self.fraction(name)

    def next(self, ready: Sequence[Named]) -> int:
        """Return which of two or more ready stacks runs next.

        Half of the seeds choose at random. The others give each stack a priority and change one at
        few moments, which finds mistakes that need a long absence of one thread (PCT, Burckhardt
        et al., 2010).
        """
        if self._orderly:
            return 0
        if not self._by_priority:
            return int(self._order.random() * len(ready))
        priorities = self._priorities
        for each in ready:
            if each.ident not in priorities:
                priorities[each.ident] = self._order.random()
        best = max(range(len(ready)), key=lambda index: priorities[ready[index].ident])
        self._left -= 1
        if self._left == 0:
            priorities[ready[best].ident] = -self._order.random()
            self._left = self._next_change()
        return best

    def _next_change(self) -> int:
        return 1 + int(self._order.expovariate(1 / 40))

    def _digest(self, name: str) -> bytes:
        return blake2b(f"{self._base}/{name}".encode(), digest_size=8).digest()
