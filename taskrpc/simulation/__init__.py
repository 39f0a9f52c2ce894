"""Simulations of robot systems: unmodified programs, in virtual time, with faults, many times.

`Scenario` says what to simulate, and `taskrpc simulate` runs it. Start reading with `run`, one run
of a scenario. `stacks` lets one thread run at a time and jumps the clock; `threads`, `loop`,
`clocks` and `state` give each program its own interpreter, as far as it can see; `search` looks
for a failing seed in the processes of `worker`, and `shrink` and `story` explain it.
"""

from __future__ import annotations

from taskrpc.simulation.scenario import Scenario

TYPE_CHECKING = False
if TYPE_CHECKING:
    from taskrpc.simulation.checking import check_scenario as check_scenario
    from taskrpc.simulation.run.world import SimulatedWorld as SimulatedWorld

__all__ = ["Scenario", "SimulatedWorld", "check_scenario"]


def __getattr__(name: str) -> object:
    # Worker processes must replace threads and clocks before anything else is imported.
    if name == "check_scenario":
        from taskrpc.simulation.checking import check_scenario

        return check_scenario
    if name == "SimulatedWorld":
        from taskrpc.simulation.run.world import SimulatedWorld

        return SimulatedWorld
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
