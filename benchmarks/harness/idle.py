"""Servers with idle connections: their memory, and the calls of other clients meanwhile."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack

from benchmarks.harness.contender import Contender
from benchmarks.harness.limits import open_files
from benchmarks.harness.processes import Child, Pair, all_cores, pin_process
from benchmarks.harness.results import Idle, Results

COUNTS = (0, 1000, 5000)
_IN_FLIGHT = 64
_OTHER_FILES = 100
_SETTLING = 0.25
"""Seconds between the last connection and the measurement."""


class _Crowded:
    """A contender's two processes, and a third that holds idle connections."""

    def __init__(self, contender: Contender, stack: ExitStack) -> None:
        self.pair = stack.enter_context(Pair(contender)).start()
        self.idler = Child("idle", contender, self.pair.env)
        stack.callback(self.idler.close)
        self.idler.ask(place=self.pair.place)
        self._place_on_cores()

    def hold(self, count: int) -> None:
        """Open or close idle connections until there are `count`."""
        self.idler.ask(count=count)
        time.sleep(_SETTLING)

    def _place_on_cores(self) -> None:
        if cores := all_cores():
            measured = {max(cores)}
            self.pair.pin(measured)
            pin_process(self.idler.pid, cores - measured or cores)


def measure_idle(
    contenders: Sequence[Contender],
    counts: Sequence[int],
    *,
    rounds: int,
    seconds: float,
    results: Results,
) -> None:
    """Measure each contender with each number of idle connections, by turns.

    Numbers above the system's limit of open files are left out. Raises ChildFailed.
    """
    possible = [count for count in counts if count + _OTHER_FILES <= open_files()]
    with ExitStack() as stack:
        crowded = [_Crowded(contender, stack) for contender in contenders]
        for _ in range(rounds):
            for each in crowded:
                _measure(each, possible, seconds, results)


def _measure(each: _Crowded, counts: Sequence[int], seconds: float, results: Results) -> None:
    held = results.idle.setdefault(each.pair.contender.name, {})
    for count in counts:
        each.hold(count)
        found = held.setdefault(count, Idle())
        memory = each.pair.usage()["memory"]
        found.add(memory, each.pair.measure(payload=0, in_flight=_IN_FLIGHT, seconds=seconds))
    each.hold(0)
