"""The common parts of fault harnesses: size, seed, and counts of the events that happened.

A harness that breaks nothing proves nothing: it requires that its faults really happened. The
same test must find a bug that is planted into the product: `@pytest.mark.planted(Bug(...), …)`
runs a test once more with each bug, and then it must fail by the count that the bug names.
"""

from __future__ import annotations

import asyncio
import collections
import contextlib
import importlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import pytest

HAPPENED = "what happened"
"""The key of the counts in a test's report, which may come from another process."""


class Counts(collections.Counter[str]):
    """How often each event happened; printed at the end of the run."""

    def check(self, *promises: str, happened: tuple[str, ...] = ()) -> None:
        """Check the counts: those in `promises` must be zero, those in `happened` must not be.

        Raises PromiseBroken, and AssertionError if too few events happened to prove anything.
        """
        if wrong := self.broken(*promises):
            raise PromiseBroken(wrong)
        idle = [what for what in happened if not self[what]]
        assert not idle, f"this shows nothing: no {', no '.join(idle)}"

    def require(self, **least: int) -> None:
        """Fail unless each event (`_` stands for a space) happened at least this often."""
        wanted = {name.replace("_", " "): count for name, count in least.items()}
        few = {name: self[name] for name, count in wanted.items() if self[name] < count}
        assert not few, f"too few faults to show anything: {few}, wanted {wanted}"

    def broken(self, *promises: str) -> dict[str, int]:
        """The broken promises, and how often each was broken."""
        return {name: self[name] for name in promises if self[name]}

    def __str__(self) -> str:
        return ", ".join(f"{name} {count}" for name, count in sorted(self.items()))


class PromiseBroken(AssertionError):
    """The product broke a promise; `counts` has the counts that should be zero."""

    def __init__(self, counts: dict[str, int]) -> None:
        self.counts = counts
        super().__init__(", ".join(f"{what}: {count}" for what, count in counts.items()))


class Patch(Protocol):
    """Replaces a name of the product."""

    def __call__(self, owner: Any, name: str, replacement: Any) -> object: ...


@dataclass(frozen=True)
class Bug:
    """A bug in the product that a harness must find.

    `plant` stands at the top level of its module, so that a child process finds it; it patches the
    product with `patch(owner, name, replacement)`. `breaks` names the count that reveals the bug.
    """

    plant: Callable[[Patch], object]
    breaks: str

    @property
    def name(self) -> str:
        return self.plant.__name__

    @property
    def place(self) -> str:
        """The place from which a child process imports the bug: see `plant_from`."""
        return f"{self.plant.__module__}:{self.plant.__qualname__}"

    @contextlib.contextmanager
    def planted(self) -> Iterator[None]:
        """Plant the bug in this process for the duration of the block."""
        with pytest.MonkeyPatch.context() as monkeypatch:
            self.plant(monkeypatch.setattr)
            yield


def plant_from(place: str) -> None:
    """Plant a bug in this process permanently; child processes do this first."""
    module, _, name = place.partition(":")
    getattr(importlib.import_module(module), name)(setattr)


class Lateness:
    """Measures the delay of the event loop, to distinguish a busy machine from a late call."""

    PERIOD = 0.005

    def __init__(self) -> None:
        self.longest = 0.0
        """Seconds."""
        self._loop = asyncio.get_running_loop()
        self._arm()

    def stop(self) -> float:
        """End the measurement; returns the longest delay in seconds."""
        self._timer.cancel()
        return self.longest

    def _arm(self) -> None:
        due = self._loop.time() + self.PERIOD
        self._timer = self._loop.call_at(due, self._ring, due)

    def _ring(self, due: float) -> None:
        self.longest = max(self.longest, self._loop.time() - due)
        self._arm()


async def read_nothing(node: Any, counts: Counts, seconds: float) -> None:
    """Let a node in memory read nothing from its publishers for so many seconds."""
    links = node._transport.topics._links.values()
    ends = [link._connection.transport for link in links if link._connection is not None]
    for transport in ends:
        counts["stopped reading"] += 1
        transport.pause_reading()
    await asyncio.sleep(seconds)
    for transport in ends:
        transport.resume_reading()


def percentile(values: list[float], share: float) -> float:
    """The value that this share of the values does not exceed."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def milliseconds(seconds: float) -> int:
    """For counts: a measured time, rounded up."""
    return math.ceil(seconds * 1000)
