"""Measured values, and Prometheus' text format 0.0.4: families of samples in, text out."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum

import msgspec

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

_SECONDS = (
    *(0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025),
    *(0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0),
)
_NAME = re.compile(r"[a-zA-Z_:][a-zA-Z0-9_:]*")
_LABEL = re.compile(r"(?!__)[a-zA-Z_][a-zA-Z0-9_]*")
_HELP_ESCAPES = str.maketrans({"\\": r"\\", "\n": r"\n"})
_LABEL_ESCAPES = str.maketrans({"\\": r"\\", "\n": r"\n", '"': r"\""})


class Kind(Enum):
    """What the samples of a family mean."""

    COUNTER = "counter"
    """A number that only grows while the program runs."""
    GAUGE = "gauge"
    """The current value."""
    HISTOGRAM = "histogram"
    """How many values were at most as large as each bound."""


class Sample(msgspec.Struct, frozen=True):
    """One number."""

    value: float
    labels: dict[str, str] | None = None
    suffix: str = ""
    """For a histogram: `_bucket`, `_sum` or `_count`."""


class Family(msgspec.Struct, frozen=True):
    """All samples of one name."""

    name: str
    """The Prometheus name; a counter's name ends with `_total`."""
    kind: Kind
    help: str
    """One sentence for the reader of the metrics."""
    samples: Sequence[Sample]


class Histogram:
    """Counts how many values were at most as large as each bound.

    Args:
        bounds: the bounds, ascending; by default bounds for seconds, from 0.1 ms to 10 s.

    Raises:
        ValueError: the bounds do not ascend.
    """

    def __init__(self, bounds: Sequence[float] | None = None) -> None:
        self._bounds = tuple(_SECONDS if bounds is None else bounds)
        if list(self._bounds) != sorted(set(self._bounds)):
            raise ValueError(f"bounds: expected ascending numbers, got {bounds!r}")
        self._counts = [0] * (len(self._bounds) + 1)  # the last one is above all bounds
        self._sum = 0.0

    def observe(self, value: float, times: int = 1) -> None:
        """Count a value, `times` times."""
        self._counts[bisect_left(self._bounds, value)] += times
        self._sum += value * times

    def samples(self, labels: Mapping[str, str] | None = None) -> list[Sample]:
        """Return the cumulative buckets, then the sum and the count."""
        own, found, below = dict(labels or {}), [], 0
        for bound, count in zip((*self._bounds, math.inf), self._counts, strict=True):
            below += count
            found.append(Sample(below, {**own, "le": format_number(bound)}, "_bucket"))
        return [*found, Sample(self._sum, own, "_sum"), Sample(below, own, "_count")]


def by_label(label: str, values: Mapping[str, float]) -> list[Sample]:
    """Return a sample for each value, sorted by the value of its label."""
    return [Sample(value, {label: name}) for name, value in sorted(values.items())]


def format_number(value: float) -> str:
    """Return a number as Prometheus reads it."""
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "+Inf" if value > 0 else "-Inf"
    return str(int(value)) if value == int(value) and abs(value) < 2**53 else repr(float(value))


def render(families: Iterable[Family]) -> str:
    """Return the text that Prometheus reads, without the families that have no samples.

    Raises:
        ValueError: a name is not valid for Prometheus, or two families have the same name.
    """
    lines: list[str] = []
    seen: set[str] = set()
    for family in families:
        if family.name in seen:
            raise ValueError(f"two families have the name {family.name}")
        seen.add(family.name)
        if family.samples:
            lines.extend(_lines(family))
    return "".join(f"{line}\n" for line in lines)


def _lines(family: Family) -> Iterator[str]:
    name = _checked(family.name, _NAME)
    yield f"# HELP {name} {family.help.translate(_HELP_ESCAPES)}"
    yield f"# TYPE {name} {family.kind.value}"
    for sample in family.samples:
        labels = _labels(sample.labels)
        yield f"{name}{sample.suffix}{labels} {format_number(sample.value)}"


def _labels(labels: Mapping[str, str] | None) -> str:
    if not labels:
        return ""
    inside = (
        f'{_checked(label, _LABEL)}="{value.translate(_LABEL_ESCAPES)}"'
        for label, value in labels.items()
    )
    return "{" + ",".join(inside) + "}"


def _checked(name: str, allowed: re.Pattern[str]) -> str:
    if not allowed.fullmatch(name):
        raise ValueError(f"expected a name that matches {allowed.pattern}, got {name!r}")
    return name
