"""The network of a simulation: connections in memory, with the delays and losses of its run."""

from __future__ import annotations

import random

from taskrpc.simulation.run.choices import Choices
from taskrpc.spi import Hub, MemoryNetwork, NetworkFaults, Settings, current_program


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


class RunNetwork(NetworkFaults):
    """The connections of one run; what they do follows from its choices."""

    def __init__(self, choices: Choices, delay: tuple[float, float]) -> None:
        super().__init__(0, delay=delay, pieces=0, cut_after=0.0, refuse=0.0, dead_after=None)
        self._choices = choices
        self._range = delay
        self._counts: dict[tuple[str, str], int] = {}
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
