"""A network in memory that delays, cuts, refuses and falls silent, all of it from one seed."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from taskrpc.testing.faulty_connections import Links
from taskrpc.transport.memory import hub_of
from taskrpc.transport.tcp.tcp_network import domain_id


class FaultyNetwork:
    """Faults between the programs of a test: `with FaultyNetwork(seed=7) as network:`.

    A program is what the nodes of one `listen` are together:
    `Node("robot", transport="memory", listen="robot")` is in the program `robot`; nodes without
    `listen` are in the program `""`. The network is that of the running event loop and
    ROS_DOMAIN_ID; connections made inside the block meet the faults.

    Arguments:
        seed: the same seed and program give the same faults.
        delay: the shortest and the longest time in seconds that bytes are on their way.
        pieces: what is sent arrives in pieces of 1 to this many bytes; 0 for whole.
        cut_after: how many bytes a connection lives for, on average; 0 for ever.
        refuse: the share of connections that are refused, 0 to 1.
        dead_after: seconds without an answer after which a system gives a connection up; as the
            `keepalive` of the nodes at its end says unless given.
    """

    def __init__(
        self,
        seed: int = 0,
        *,
        delay: tuple[float, float] = (0.0, 0.0),
        pieces: int = 0,
        cut_after: float = 0.0,
        refuse: float = 0.0,
        dead_after: float | None = None,
    ) -> None:
        self._hub = hub_of(domain_id())
        self._links = Links(
            seed,
            delay=delay,
            pieces=pieces,
            cut_after=cut_after,
            refuse=refuse,
            dead_after=dead_after,
        )
        self.happened = self._links.happened
        """How often each thing happened: `connections`, `refusals`, `cuts`, `silences`, `deaths`
        (a system gave a silent connection up), `crashes`."""

    def __enter__(self) -> Self:
        self._hub.conditions = self._links
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._hub.conditions = None
        self.heal()

    def partition(self, a: str, b: str, *, both: bool = True) -> None:
        """Let nothing pass from program `a` to `b`, nor back unless `both` is false.

        Nobody is told; what is sent arrives once the network has healed, if the connection still
        lives.
        """
        self._links.silent.update([(a, b), (b, a)] if both else [(a, b)])
        self._links.healed.clear()

    def heal(self) -> None:
        """Let everything pass again."""
        self._links.silent.clear()
        self._links.healed.set()
        for wire in list(self._links.wires):
            wire.go_on()

    def cut(self, a: str, b: str) -> None:
        """Cut all connections between two programs; what is on its way is lost."""
        for wire in list(self._links.wires):
            if {wire.caller, wire.called} == {a, b}:
                wire.cut()

    def crash(self, program: str) -> None:
        """Take a program off the network as if it were killed: it learns nothing more.

        Its callers and servers find their connections reset. End its nodes and tasks yourself.
        """
        self.happened["crashes"] += 1
        gone = [place for place, each in self._hub.listeners.items() if each.program == program]
        for place in gone:
            del self._hub.listeners[place]
        for network in [each for each in self._hub.rosters if each.program == program]:
            del self._hub.rosters[network]
        for wire in list(self._links.wires):
            wire.crash(program)
        self._hub.changed()
