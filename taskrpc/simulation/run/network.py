"""The network of a simulation: connections in memory, with the delays and losses of its run."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from taskrpc.simulation.run.choices import Choices
from taskrpc.spi import (
    FaultyConnection,
    Hub,
    MemoryNetwork,
    NetworkFaults,
    Settings,
    current_program,
)


def open_network(settings: Settings) -> MemoryNetwork:
    """Return the network of the running program."""
    return MemoryNetwork(
        domain=settings.domain,
        program=current_program.get(),
        token=settings.token,
        accounts=settings.account_source(),
    )


_FIRST = 4
"""With so many pieces in each direction two programs connect, and look up a service."""
_LONGEST_FIRST = 0.5
"""The most seconds that each of these takes: with more, no two programs could connect in time."""
_BREAKS_AFTER = 4000.0
"""The average number of bytes after which a connection breaks that does not last."""


class RunNetwork(NetworkFaults):
    """The connections of one run; what they do follows from its choices.

    Args:
        choices: all chance of the run.
        delay: the least and the most seconds that bytes take.
        cut: the share of the connections that break.
        tell: is called with a fault that has happened and the program that it concerns.
    """

    def __init__(
        self,
        choices: Choices,
        delay: tuple[float, float],
        cut: float,
        tell: Callable[[str, str], object],
    ) -> None:
        super().__init__(0, delay=delay, pieces=0, cut_after=0.0, refuse=0.0, dead_after=None)
        self._choices = choices
        self._range = delay
        self._cut = cut
        self._tell = tell
        self._counts: dict[tuple[str, str], int] = {}
        self._connected: dict[tuple[str, str], int] = {}
        """How often two programs have connected."""
        self._doomed: dict[FaultyConnection, str] = {}
        """The names of the faults that connections may meet."""
        self.is_calm = False
        """Whether faults are off."""

    def lag(self, source: str, target: str) -> float:
        """Return how many seconds the next bytes take to arrive."""
        least, most = self._range
        if self.is_calm or most == 0 or not self._choices.happens("delays", 1.0):
            return 0.0
        count = self._counts[source, target] = self._counts.get((source, target), 0) + 1
        if count <= _FIRST:
            least, most = min(least, _LONGEST_FIRST), min(most, _LONGEST_FIRST)
        return self._choices.seconds(f"delay {count} {source} {target}", least, most)

    def calm_down(self) -> None:
        """End all faults."""
        self.is_calm = True
        for connection in self.connections:
            connection.spare()

    def lifetime(self, connection: FaultyConnection) -> float:
        """Return after how many bytes a new connection breaks."""
        ends = connection.caller, connection.called
        count = self._connected[ends] = self._connected.get(ends, 0) + 1
        name = f"cut connection {count} of {ends[0]} with {ends[1]}"
        if self.is_calm or not self._choices.happens(name, self._cut):
            return math.inf
        self._doomed[connection] = name
        return self._choices.chance(f"when to {name}").expovariate(1 / _BREAKS_AFTER)

    def was_cut(self, connection: FaultyConnection) -> None:
        """Note that a connection has broken."""
        self._tell(self._doomed[connection], connection.caller.partition("#")[0])


class Hubs(dict[int, Hub]):
    """The memory networks of a run, by domain; made when a program first uses the domain."""

    def __init__(self, chance: random.Random, network: RunNetwork) -> None:
        super().__init__()
        self._chance = chance
        self._network = network

    def __missing__(self, domain: int) -> Hub:
        hub = self[domain] = Hub(self._chance)
        hub.conditions = self._network
        return hub
