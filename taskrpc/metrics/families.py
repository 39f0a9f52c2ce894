"""What is measured, as plain values: families of samples, and histograms that make them."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from enum import Enum

import msgspec

_SECONDS = (
    *(0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025),
    *(0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0),
)


class Kind(Enum):
    """What the samples of a family mean."""

    COUNTER = "counter"
    """Only grows, while the program runs."""
    GAUGE = "gauge"
    """What is now."""
    HISTOGRAM = "histogram"


class Sample(msgspec.Struct, frozen=True):
    """One number."""

    value: float
    labels: dict[str, str] | None = None
    suffix: str = ""
    """For a histogram: `_bucket`, `_sum` or `_count`."""


class Family(msgspec.Struct, frozen=True):
    """All samples of one name; a counter's name ends with `_total`."""

    name: str
    kind: Kind
    help: str
    samples: Sequence[Sample]


class Histogram:
    """Counts how many values were at most as large as each bound.

    `bounds` must rise; without them they are fit for seconds, from 0.1 ms to 10 s.
    """

    def __init__(self, bounds: Sequence[float] | None = None) -> None:
        self._bounds = tuple(_SECONDS if bounds is None else bounds)
        if list(self._bounds) != sorted(set(self._bounds)):
            raise ValueError(f"bounds: expected numbers that rise, got {bounds!r}")
        self._counts = [0] * (len(self._bounds) + 1)
        self._sum = 0.0

    def observe(self, value: float, times: int = 1) -> None:
        """Count a value that was met once, or several times."""
        self._counts[bisect_left(self._bounds, value)] += times
        self._sum += value * times

    def samples(self, labels: Mapping[str, str] | None = None) -> list[Sample]:
        """The buckets, each with those below in it, then the sum and the count."""
        own, found, below = dict(labels or {}), [], 0
        for bound, count in zip((*self._bounds, math.inf), self._counts, strict=True):
            below += count
            found.append(Sample(below, {**own, "le": shown(bound)}, "_bucket"))
        return [*found, Sample(self._sum, own, "_sum"), Sample(below, own, "_count")]


def shown(value: float) -> str:
    """A number as Prometheus reads it."""
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "+Inf" if value > 0 else "-Inf"
    return str(int(value)) if value == int(value) and abs(value) < 2**53 else repr(float(value))


def by_label(label: str, values: Mapping[str, float]) -> list[Sample]:
    """A sample for each value, sorted by the label that tells them apart."""
    return [Sample(value, {label: name}) for name, value in sorted(values.items())]
