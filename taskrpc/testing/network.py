"""A network in memory that delays, cuts, refuses and falls silent, all of it from one seed."""

from __future__ import annotations

import asyncio
import contextvars
import random
from collections import Counter
from types import TracebackType
from typing import Self

from taskrpc.testing.wires import End, Wire
from taskrpc.transport.connection import DEAD_AFTER
from taskrpc.transport.memory import Listener, hub_of
from taskrpc.transport.tcp import domain_id


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
        dead_after: seconds without an answer after which a system gives a connection up.
    """

    def __init__(
        self,
        seed: int = 0,
        *,
        delay: tuple[float, float] = (0.0, 0.0),
        pieces: int = 0,
        cut_after: float = 0.0,
        refuse: float = 0.0,
        dead_after: float = DEAD_AFTER,
    ) -> None:
        self.delay = delay
        self.pieces = pieces
        self.cut_after = cut_after
        self.refuse = refuse
        self.dead_after = dead_after
        self.happened: Counter[str] = Counter()
        """How often each fault happened: `connections`, `refusals`, `cuts`, `silences`, `deaths`,
        `crashes`."""
        self.chance = random.Random(seed)
        self._hub = hub_of(domain_id())
        self._wires: dict[Wire, None] = {}
        self._silent: set[tuple[str, str]] = set()
        self._healed = asyncio.Event()

    def __enter__(self) -> Self:
        self._hub.conditions = self
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._hub.conditions = None
        self.heal()

    # Faults at will

    def partition(self, a: str, b: str, *, both: bool = True) -> None:
        """Let nothing pass from program `a` to `b`, nor back unless `both` is false.

        Nobody is told; what is sent arrives once the network has healed, if the connection still
        lives.
        """
        self._silent.add((a, b))
        if both:
            self._silent.add((b, a))
        self._healed.clear()

    def heal(self) -> None:
        """Let everything pass again."""
        self._silent.clear()
        self._healed.set()
        for wire in list(self._wires):
            wire.go_on()

    def cut(self, a: str, b: str) -> None:
        """Cut all connections between two programs; what is on its way is lost."""
        for wire in list(self._wires):
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
        for wire in list(self._wires):
            wire.crash(program)
        self._hub.changed()

    # What the wires and the memory transport ask

    async def connect(self, caller: str, listener: Listener) -> None:
        """Return once a listener has heard of a caller. Raises ConnectionRefusedError."""
        await asyncio.sleep(self.lag())
        while self.is_silent(caller, listener.program):
            await self._healed.wait()
        if self.chance.random() < self.refuse:
            self.happened["refusals"] += 1
            raise ConnectionRefusedError("the network refused the connection")

    def join(
        self, client: asyncio.BufferedProtocol, caller: str, listener: Listener, name: str
    ) -> None:
        """Connect a client with a new connection of a listener."""
        self.happened["connections"] += 1
        wire = Wire(self, caller, listener.program)
        self._wires[wire] = None
        context = listener.context
        server = context.run(listener.factory)
        one = End(client, name, contextvars.copy_context())
        other = End(server, f"a client of {name}", context)
        wire.tie(one, other)
        context.run(server.connection_made, other)
        client.connection_made(one)

    def ended(self, wire: Wire) -> None:
        """Both ends of a wire are gone."""
        self._wires.pop(wire, None)

    def is_silent(self, source: str, target: str) -> bool:
        """Whether nothing passes that way."""
        return (source, target) in self._silent

    def lag(self) -> float:
        """How long the next bytes are on their way."""
        return self.chance.uniform(*self.delay)

    def cut_up(self, data: bytes) -> list[bytes]:
        """What is sent, in the pieces in which it arrives."""
        found, begin = [], 0
        while begin < len(data):
            size = self.chance.randint(1, self.pieces) if self.pieces else len(data)
            found.append(data[begin : begin + size])
            begin += size
        return found

    def lifetime(self) -> float:
        """Bytes until a new connection is cut."""
        return self.chance.expovariate(1 / self.cut_after) if self.cut_after else float("inf")
