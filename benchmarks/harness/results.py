"""What came out, and the figures that the tables show of it."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.harness.load import Sample
from benchmarks.harness.workloads import Workload

MEASURES: dict[str, Callable[[Sample], float]] = {
    "p50": lambda sample: sample["p50"],
    "p99": lambda sample: sample["p99"],
    "rate": lambda sample: sample["calls"] / sample["elapsed"],
    "cpu": lambda sample: sample["cpu"] / sample["calls"],
}
"""What is taken from a sample: seconds, and calls a second."""


@dataclass(frozen=True)
class Figure:
    """One cell: the median of the rounds."""

    value: float
    ratio: float
    """To the baseline of the same round: the median of the rounds' ratios."""
    low: float
    high: float
    """The least and the greatest of the rounds' ratios."""


def figure(values: Sequence[float], baseline: Sequence[float]) -> Figure | None:
    """Values of the rounds, each divided by its round's baseline; None where one of those is 0.

    The CPU time of a short round is 0 on Windows, whose clock for it ticks every 16 ms.
    """
    if 0 in baseline:
        return None
    ratios = [value / base for value, base in zip(values, baseline, strict=True)]
    return Figure(statistics.median(values), statistics.median(ratios), min(ratios), max(ratios))


@dataclass
class Idle:
    """A server with so many idle connections."""

    memory: list[float] = field(default_factory=list)
    """Bytes of the server; only the first, before connections came and went, is meaningful."""
    samples: list[Sample] = field(default_factory=list)


@dataclass
class Results:
    """Everything of one run."""

    about: dict[str, Any]
    """Date, machine, settings."""
    versions: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    """Contenders that did not take part, and why."""
    calls: dict[str, dict[str, list[tuple[Sample, Sample]]]] = field(default_factory=dict)
    """By workload and contender: for each round the sample, and the baseline's."""
    idle: dict[str, dict[int, Idle]] = field(default_factory=dict)
    """By contender and number of idle connections."""
    start_up: dict[str, list[float]] = field(default_factory=dict)
    """Seconds, by contender."""
    commands: dict[str, list[float]] = field(default_factory=dict)
    """Seconds, by command line."""
    imports: dict[str, dict[str, tuple[int, float]]] = field(default_factory=dict)
    """By command line and package: modules imported, and their own seconds."""

    @property
    def pinned(self) -> bool:
        """Whether the figures that count are of one core."""
        return any(key.startswith("pinned") for key in self.calls)

    def add(self, workload: Workload, name: str, sample: Sample, baseline: Sample) -> None:
        """Note what a round brought."""
        by_name = self.calls.setdefault(workload.key, {})
        by_name.setdefault(name, []).append((sample, baseline))

    def figure(self, workload: Workload, name: str, measure: str) -> Figure | None:
        """A cell of the tables; None where it was not measured."""
        pairs = self.calls.get(workload.key, {}).get(name)
        if not pairs:
            return None
        take = MEASURES[measure]
        return figure([take(one) for one, _ in pairs], [take(base) for _, base in pairs])

    def idle_bytes(self, name: str, count: int) -> float | None:
        """Bytes of server memory for each of so many idle connections."""
        held = self.idle.get(name, {})
        if not count or count not in held or 0 not in held or not held[0].memory[0]:
            return None
        return (held[count].memory[0] - held[0].memory[0]) / count

    def idle_figure(self, name: str, count: int, measure: str) -> Figure | None:
        """A measure with so many idle connections, relative to the same server's without."""
        held = self.idle.get(name, {})
        if count not in held or 0 not in held:
            return None
        take = MEASURES[measure]
        return figure(
            [take(one) for one in held[count].samples], [take(one) for one in held[0].samples]
        )

    def start_figure(self, name: str, baseline: str) -> Figure | None:
        """Seconds from starting a server to its first answer."""
        if name not in self.start_up or baseline not in self.start_up:
            return None
        return figure(self.start_up[name], self.start_up[baseline])
