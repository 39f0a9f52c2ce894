"""A figure over sizes, and the power of the size with which it grows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    """One figure of a topic."""

    name: str
    title: str
    unit: str
    """`µs`, `bytes`, `times`, `calls/s` or `MB/s`."""
    limit: float = 0.3
    """The exponent that it may have: 0 is constant, 1 is linear. Logarithms fit to about 0.1."""

    @property
    def is_rate(self) -> bool:
        """Whether more is better, so that a cost grows when this falls."""
        return self.unit.endswith("/s")


@dataclass(frozen=True)
class Curve:
    """A measure over the sizes of its topic."""

    measure: Measure
    sizes: tuple[int, ...]
    values: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """The power of the size with which the cost grows, over all sizes."""
        return self._fitted(self.sizes, self.values)

    @property
    def end_exponent(self) -> float:
        """The same over the last factor of hundred, where fixed costs hide nothing any more."""
        first = next(i for i, size in enumerate(self.sizes) if size * 100 >= self.sizes[-1])
        return self._fitted(self.sizes[first:], self.values[first:])

    @property
    def is_within(self) -> bool:
        """Whether it grows no faster than it may, in the end."""
        return self.end_exponent <= self.measure.limit

    @property
    def known(self) -> Curve:
        """The part that could be measured."""
        pairs = [pair for pair in zip(self.sizes, self.values, strict=True) if pair[1] > 0]
        sizes, values = zip(*pairs, strict=True) if pairs else ((), ())
        return Curve(self.measure, sizes, values)

    def _fitted(self, sizes: Sequence[int], values: Sequence[float]) -> float:
        slope = power(sizes, values)
        return -slope if self.measure.is_rate else slope


def power(sizes: Sequence[float], values: Sequence[float]) -> float:
    """The least-squares slope of log value over log size; 0.0 for fewer than two sizes."""
    points = [
        (math.log(s), math.log(v)) for s, v in zip(sizes, values, strict=True) if s > 0 and v > 0
    ]
    if len(points) < 2:
        return 0.0
    mean_x = sum(x for x, _ in points) / len(points)
    mean_y = sum(y for _, y in points) / len(points)
    spread = sum((x - mean_x) ** 2 for x, _ in points)
    return sum((x - mean_x) * (y - mean_y) for x, y in points) / spread
