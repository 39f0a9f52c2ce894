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


@dataclass
class Rounds:
    """One measure, round by round."""

    values: list[float] = field(default_factory=list)
    ratios: list[float | None] = field(default_factory=list)
    """To the baseline of the same round; None where that is 0.

    The CPU time of a short round is 0 on Windows, whose clock for it ticks every 16 ms.
    """

    def add(self, value: float, baseline: float) -> None:
        """Note what a round brought."""
        self.values.append(value)
        self.ratios.append(value / baseline if baseline else None)

    def figure(self) -> Figure | None:
        """The medians; None without a ratio for each round."""
        ratios = [ratio for ratio in self.ratios if ratio is not None]
        if len(ratios) < len(self.values):
            return None
        middle = statistics.median(ratios)
        return Figure(statistics.median(self.values), middle, min(ratios), max(ratios))


def figure(values: Sequence[float], baseline: Sequence[float]) -> Figure | None:
    """Values of the rounds, each divided by its round's baseline."""
    rounds = Rounds()
    for value, base in zip(values, baseline, strict=True):
        rounds.add(value, base)
    return rounds.figure()


@dataclass
class Idle:
    """A server with so many idle connections."""

    memory: list[float] = field(default_factory=list)
    """Bytes of the server; only the first, before connections came and went, is meaningful."""
    measures: dict[str, list[float]] = field(default_factory=dict)
    """What calls took, round by round."""

    def add(self, memory: float, sample: Sample) -> None:
        """Note what a round brought."""
        self.memory.append(memory)
        for measure, take in MEASURES.items():
            self.measures.setdefault(measure, []).append(take(sample))


@dataclass
class Results:
    """Everything of one run."""

    about: dict[str, Any]
    """Date, machine, settings."""
    versions: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    """Contenders that did not take part, and why."""
    calls: dict[str, dict[str, dict[str, Rounds]]] = field(default_factory=dict)
    """By workload, contender and measure."""
    idle: dict[str, dict[int, Idle]] = field(default_factory=dict)
    """By contender and number of idle connections."""
    start_up: dict[str, list[float]] = field(default_factory=dict)
    """Seconds, by contender."""
    commands: dict[str, list[float]] = field(default_factory=dict)
    """Seconds, by command line."""
    imports: dict[str, dict[str, tuple[int, float]]] = field(default_factory=dict)
    """By command line and package: modules imported, and their own seconds."""

    @property
    def python(self) -> str:
        """The version of Python without its last part: "3.12"."""
        version: str = self.about["python"].rpartition(" ")[2]
        return ".".join(version.split(".")[:2])

    @property
    def pinned(self) -> bool:
        """Whether the figures that count are of one core."""
        return any(key.startswith("pinned") for key in self.calls)

    def add(self, workload: Workload, name: str, sample: Sample, baseline: Sample) -> None:
        """Note what a round brought."""
        measures = self.calls.setdefault(workload.key, {}).setdefault(name, {})
        for measure, take in MEASURES.items():
            measures.setdefault(measure, Rounds()).add(take(sample), take(baseline))

    def figure(self, workload: Workload, name: str, measure: str) -> Figure | None:
        """A cell of the tables; None where it was not measured."""
        measures = self.calls.get(workload.key, {}).get(name)
        return measures[measure].figure() if measures else None

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
        return figure(held[count].measures[measure], held[0].measures[measure])

    def start_figure(self, name: str, baseline: str) -> Figure | None:
        """Seconds from starting a server to its first answer."""
        if name not in self.start_up or baseline not in self.start_up:
            return None
        return figure(self.start_up[name], self.start_up[baseline])
