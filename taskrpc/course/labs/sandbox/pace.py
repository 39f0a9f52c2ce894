"""How fast time passes while a submission is checked: slower on a busy machine."""

from __future__ import annotations

import time
from collections.abc import Callable

from taskrpc.course.labs.sandbox import speed

TOLERATED = 2.0
"""How many times slower than an idle machine is still quick enough for the speeds of the labs."""
MOST = 8.0
"""How many times slower than on an idle machine time passes at most."""
_SAMPLE = 0.02
"""Seconds of processor time that are measured."""


def slowness(
    clock: Callable[[], float] = speed.real_monotonic,
    worked: Callable[[], float] = time.thread_time,
) -> float:
    """Measure how many times longer a computation takes now than on an idle machine.

    Args:
        clock: the real time in seconds.
        worked: the seconds of processor time that this thread has had.
    """
    began, before = clock(), worked()
    while (done := worked() - before) < _SAMPLE:
        pass
    return max(1.0, (clock() - began) / done)


def stretch(slowness: float, run: int) -> float:
    """Return how many times slower time has to pass in the first or second run of a check."""
    return min(MOST, max(1.0, slowness / TOLERATED) * run)


class Pace:
    """Sets how fast time passes in this process: slower on a busy machine, and in second runs.

    Args:
        factor: the speed on an idle machine; 1 for real time, which never becomes slower.
        usual: the speed for which the limits of the checks are made.
        measure: returns the slowness of the machine.
    """

    def __init__(
        self, factor: float, usual: float, measure: Callable[[], float] = slowness
    ) -> None:
        self._factor = factor
        self._usual = usual
        self._measure = measure
        self._slowness = measure()
        self.first_run()

    @property
    def is_busy(self) -> bool:
        """Whether the machine was busy when it was measured last."""
        return self._slowness > TOLERATED

    @property
    def slower(self) -> float:
        """How many times slower than usual time passes; limits in real time are longer by that."""
        return self._usual / speed.speed()

    def first_run(self) -> None:
        """Let time pass as fast as the machine allows."""
        self._set(1)

    def second_run(self) -> None:
        """Let time pass slower than in the first run, and as slow as the machine needs it now."""
        self._slowness = max(self._slowness, self._measure())
        self._set(2)

    def _set(self, run: int) -> None:
        slower = 1.0 if self._factor == 1 else stretch(self._slowness, run)
        speed.set_speed(self._factor / slower)
