"""The performance goals of taskrpc, and whether a run met them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.contenders import BASELINE
from benchmarks.harness.results import Results
from benchmarks.harness.workloads import MIB, Workload

LOOPS = ("", ", uvloop")
"""What a contender's name ends with, by event loop."""

_Measured = Callable[[Results, str], float | None]


@dataclass(frozen=True)
class Goal:
    """One line of the table of goals."""

    text: str
    limits: tuple[float, float]
    """On asyncio's own loop, and on uvloop."""
    measured: _Measured
    """The ratio in a run, for the ending of a contender's name."""
    at_most: bool = True

    def is_met(self, value: float, loop: int) -> bool:
        """Whether a ratio is good enough."""
        limit = self.limits[loop]
        return value <= limit if self.at_most else value >= limit


def _call(name: str, measure: str, **workload: int) -> _Measured:
    def measured(results: Results, suffix: str) -> float | None:
        what = Workload(pinned=results.pinned, **workload)
        found = results.figure(what, name + suffix, measure)
        return found.ratio if found else None

    return measured


def _idle_memory(results: Results, suffix: str) -> float | None:
    counts = [max(held) for held in results.idle.values()]
    if not counts:
        return None
    ours = results.idle_bytes("taskrpc" + suffix, counts[0])
    raw = results.idle_bytes(BASELINE.name, counts[0])
    return ours / raw if ours and raw else None


def _idle_p99(results: Results, suffix: str) -> float | None:
    found = results.idle_figure("taskrpc" + suffix, 1000, "p99")
    return found.ratio if found else None


def _start_up(results: Results, suffix: str) -> float | None:
    found = results.start_figure("taskrpc" + suffix, BASELINE.name)
    return found.ratio if found else None


def _once(results: Results, suffix: str) -> float | None:
    """An exactly-once call's time to a plain call's."""
    once = _call("taskrpc exactly once", "p50")(results, suffix)
    plain = _call("taskrpc", "p50")(results, suffix)
    return once / plain if once and plain else None


GOALS = (
    Goal("p50, plain callback", (0.62, 0.48), _call("taskrpc", "p50")),
    Goal("p50, async callback", (0.75, 0.58), _call("taskrpc async", "p50")),
    Goal(
        "calls/s at 64 in flight, plain callback",
        (1.25, 1.6),
        _call("taskrpc", "rate", in_flight=64),
        at_most=False,
    ),
    Goal(
        "calls/s at 64 in flight, async callback",
        (0.90, 1.2),
        _call("taskrpc async", "rate", in_flight=64),
        at_most=False,
    ),
    Goal("CPU a call at 64 in flight", (0.55, 0.40), _call("taskrpc", "cpu", in_flight=64)),
    Goal("1 MiB echo, MB/s", (1.0, 1.0), _call("taskrpc", "rate", payload=MIB), at_most=False),
    Goal("server memory for an idle connection", (1.6, 1.6), _idle_memory),
    Goal("p50 of an exactly-once call in memory to a plain call's", (1.15, 1.15), _once),
    Goal("start of a server to its first answer", (1.5, 1.5), _start_up),
    Goal("p99 at 64 in flight, 1,000 idle connections to none", (1.1, 1.1), _idle_p99),
    Goal("blocking client (`taskrpc.sync`), p50", (0.9, 0.9), _call("taskrpc.sync", "p50")),
)
