"""Nodes connected in memory, and a network between them with faults from one seed."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from typing import Self

from taskrpc.core.transport.memory import hub_of
from taskrpc.core.transport.settings import domain_id
from taskrpc.node import Node
from taskrpc.testing.faulty_connections import NetworkFaults


@contextlib.asynccontextmanager
async def connected_nodes(*names: str) -> AsyncIterator[tuple[Node, ...]]:
    """Start nodes with these names that are connected with each other and with no other program.

    They are connected in memory, so a test needs no sockets and can run in virtual time:
    `async with connected_nodes("server", "client") as (server, client):`.
    """
    async with contextlib.AsyncExitStack() as nodes:
        yield tuple(
            [await nodes.enter_async_context(Node(name, transport="memory")) for name in names]
        )


class FaultyNetwork:
    """Faults between the programs of a test: `with FaultyNetwork(seed=7) as network:`.

    All nodes with the same `listen` form one program:
    `Node("robot", transport="memory", listen="robot")` is in the program `robot`; nodes without
    `listen` are in the program `""`. The network is that of the running event loop and
    ROS_DOMAIN_ID. The faults happen to the connections that are made inside the block.

    Args:
        seed: the same seed and the same test give the same faults.
        delay: the minimum and maximum seconds that bytes take to arrive.
        pieces: bytes arrive in pieces of 1 to this many; 0: as they were sent.
        cut_after: the average number of bytes after which a connection is cut; 0: never.
        refuse: the fraction of connections that are refused, 0 to 1.
        dead_after: seconds without acknowledgement after which the operating system finds a
            connection dead; by default as the `keepalive` of the node says.
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
        self._faults = NetworkFaults(
            seed,
            delay=delay,
            pieces=pieces,
            cut_after=cut_after,
            refuse=refuse,
            dead_after=dead_after,
        )
        self.happened = self._faults.happened
        """Counts of `connections`, `refusals`, `cuts`, `silences`, `deaths` (silent connections
        that the operating system found dead) and `crashes`."""

    def __enter__(self) -> Self:
        self._hub.conditions = self._faults
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._hub.conditions = None
        self.heal()

    def partition(self, a: str, b: str, *, both: bool = True) -> None:
        """Let nothing pass from program `a` to `b`, and with `both` nothing back either.

        The programs get no error. What they send arrives after `heal`, on the connections that
        still exist.
        """
        self._faults.silent.update([(a, b), (b, a)] if both else [(a, b)])

    def heal(self) -> None:
        """Let everything pass again."""
        self._faults.heal()

    def cut(self, a: str, b: str) -> None:
        """Cut all connections between two programs; the bytes in flight are lost."""
        for connection in list(self._faults.connections):
            if {connection.caller, connection.called} == {a, b}:
                connection.cut()

    def crash(self, program: str) -> None:
        """Take a program off the network as if it were killed: it gets no callback any more.

        The programs that it was connected with find their connections reset. End its nodes and
        asyncio tasks yourself.
        """
        self.happened["crashes"] += 1
        self._faults.crash(program, self._hub)
