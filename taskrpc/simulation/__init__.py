"""Simulations of robot systems: unmodified programs, in virtual time, with faults, many times.

`Scenario` says what to simulate, and `taskrpc simulate` runs it. Start reading with `run`, one run
of a scenario. `stacks` lets one thread run at a time and jumps the clock; `threads`, `loop`,
`clocks` and `state` give each program its own interpreter, as far as it can see; `search` looks
for a failing seed in the processes of `worker`, and `shrink` and `story` explain it.
"""

from taskrpc.simulation.scenario import Scenario

__all__ = ["Scenario"]
