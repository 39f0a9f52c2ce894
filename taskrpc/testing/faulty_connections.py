"""The connections of a faulty network: bytes arrive later, in pieces, or never."""

from __future__ import annotations

import asyncio
import contextvars
import math
import random
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import TypeVar, cast

from taskrpc.core.transport.connection.connection import Connection
from taskrpc.core.transport.memory import Hub, Listener
from taskrpc.core.transport.pipe import Pipe

_Result = TypeVar("_Result")


class NetworkFaults:
    """The faults of a network and its connections; the `Conditions` of a hub.

    The arguments are those of `FaultyNetwork`.
    """

    def __init__(
        self,
        seed: int,
        *,
        delay: tuple[float, float],
        pieces: int,
        cut_after: float,
        refuse: float,
        dead_after: float | None,
    ) -> None:
        self.dead_after = dead_after
        self.happened: Counter[str] = Counter()
        """How often each kind of fault happened; see `FaultyNetwork.happened`."""
        self.silent: set[tuple[str, str]] = set()
        """The directions (from program, to program) in which nothing passes."""
        self._connecting: list[asyncio.Future[None]] = []
        """Programs whose requests to connect cannot pass now."""
        self.connections: dict[FaultyConnection, None] = {}
        self._random = random.Random(seed)
        self._delay = delay
        self._pieces = pieces
        self._cut_after = cut_after
        self._refuse = refuse

    async def connect(self, caller: str, listener: Listener) -> None:
        """Wait until a listener has the request to connect; raises ConnectionRefusedError."""
        await asyncio.sleep(self.lag(caller, listener.program))
        while {(caller, listener.program), (listener.program, caller)} & self.silent:
            healed = asyncio.get_running_loop().create_future()
            self._connecting.append(healed)
            await healed
        if self._random.random() < self._refuse:
            self.happened["refusals"] += 1
            raise ConnectionRefusedError("the network refused the connection")

    def join(
        self, client: asyncio.BufferedProtocol, caller: str, listener: Listener, name: str
    ) -> None:
        """Connect a client with a new connection of a listener."""
        self.happened["connections"] += 1
        context, loop = listener.context, listener.loop
        server = _run_on(loop, context, listener.factory)
        client_end = FaultyPipe(client, name, contextvars.copy_context())
        server_end = _run_on(loop, context, FaultyPipe, server, f"a client of {name}", context)
        connection = FaultyConnection(self, caller, listener.program, client_end, server_end)
        self.connections[connection] = None
        _run_on(loop, context, server.connection_made, server_end)
        client.connection_made(client_end)

    def heal(self) -> None:
        """Let everything pass again."""
        self.silent.clear()
        connecting, self._connecting = self._connecting, []
        for each in connecting:
            if not each.done():
                each.set_result(None)
        for connection in list(self.connections):
            connection.heal()

    def crash(self, program: str, hub: Hub) -> None:
        """Take a program off a hub as if it were killed; see `FaultyNetwork.crash`."""
        gone = [address for address, each in hub.listeners.items() if each.program == program]
        for address in gone:
            del hub.listeners[address]
        for network in [each for each in hub.entries if each.program == program]:
            del hub.entries[network]
        for connection in list(self.connections):
            connection.crash(program)
        hub.changed()

    def lag(self, source: str, target: str) -> float:
        """Return how many seconds the next bytes take from one program to another."""
        return self._random.uniform(*self._delay)

    def split(self, data: bytes) -> list[bytes]:
        """Return sent bytes as the pieces in which they arrive."""
        found, begin = [], 0
        while begin < len(data):
            size = self._random.randint(1, self._pieces) if self._pieces else len(data)
            found.append(data[begin : begin + size])
            begin += size
        return found

    def lifetime(self, connection: FaultyConnection) -> float:
        """Return after how many bytes to cut a new connection."""
        return self._random.expovariate(1 / self._cut_after) if self._cut_after else math.inf

    def was_cut(self, connection: FaultyConnection) -> None:
        """Note that a connection was cut."""
        self.happened["cuts"] += 1


def _run_on(
    loop: asyncio.AbstractEventLoop,
    context: contextvars.Context,
    function: Callable[..., _Result],
    *arguments: object,
) -> _Result:
    """Call a function as a callback of a loop, which may be that of another program."""
    here = asyncio.get_running_loop()
    asyncio._set_running_loop(loop)
    try:
        return context.run(function, *arguments)
    finally:
        asyncio._set_running_loop(here)


class FaultyPipe(Pipe):
    """One end of a connection; its callbacks run in its own program's context."""

    incoming: Direction
    """The direction towards this end."""

    def __init__(
        self, protocol: asyncio.BufferedProtocol, name: str, context: contextvars.Context
    ) -> None:
        super().__init__(protocol, name)
        self.context = context
        self.loop = self._loop

    def arrived(self, piece: bytes) -> None:
        """Deliver bytes that have arrived."""
        if self._lost:
            cast("FaultyPipe", self.peer).reset()
        else:
            self._inbox.append(memoryview(piece))
            self._plan_delivery()

    def end(self) -> None:
        """End the connection after the bytes that have arrived."""
        super()._end()

    def reset(self) -> None:
        """Reset the connection as if the other end had vanished."""
        self._reset()

    def die(self) -> None:
        """Lose the connection because the operating system found it dead."""
        self._closing = True
        self._lose()

    def vanish(self) -> None:
        """Remove this end without any callback: its program was killed."""
        self._closing = self._lost = True
        self.incoming.close()

    @property
    def keepalive_timeout(self) -> float:
        """Seconds without acknowledgement after which the system finds the connection dead."""
        return cast("Connection", self._protocol).owner.keepalive.dead_after

    @property
    def is_lost(self) -> bool:
        """Whether this end has lost the connection."""
        return self._lost

    def _receive(self, data: bytes) -> None:
        self._inbox_size += len(data)  # bytes in flight count as unread too
        self.incoming.send(data)

    def _end(self) -> None:
        self.incoming.put(super()._end)

    def _reset(self) -> None:
        if not self.incoming.connection.is_cut:  # a cut connection is about to end anyway
            self.incoming.clear()
            self.incoming.put(super()._reset)

    def _plan_delivery(self) -> None:
        if not self._delivery_planned:
            self._delivery_planned = True
            self._loop.call_soon(self._deliver, context=self.context)

    def _wake_sender(self) -> None:
        sender = cast("FaultyPipe", self.peer)
        sender.loop.call_soon(super()._wake_sender, context=sender.context)

    def _lose(self) -> None:
        if not self._lost:
            super()._lose()
            self.incoming.connection.end_lost()


class Direction:
    """One direction of a connection: keeps the order, and holds back what cannot pass now."""

    def __init__(
        self, connection: FaultyConnection, source: str, target: str, end: FaultyPipe
    ) -> None:
        self.connection = connection
        self._source, self._target = source, target  # the names of the programs
        self._end = end
        self._loop = end.loop
        # What happens at the end, with its time of arrival.
        self._queue: deque[tuple[float, Callable[[], object]]] = deque()
        self._last = 0.0  # the arrival time of the newest entry, so that nothing overtakes it
        self._timer: asyncio.TimerHandle | None = None
        self._death: asyncio.TimerHandle | None = None

    @property
    def is_silent(self) -> bool:
        """Whether nothing passes."""
        return (self._source, self._target) in self.connection.faults.silent

    def send(self, data: bytes) -> None:
        """Let bytes pass, and cut the connection if its lifetime ends with them."""
        passing = self.connection.spend(len(data))
        for piece in self.connection.faults.split(data[:passing]):
            self.put(partial(self._end.arrived, piece))
        if passing < len(data):
            self.connection.cut(keep=True)
        elif self.connection.is_silent:
            self._expect_death()

    def put(self, callback: Callable[[], object]) -> None:
        """Call back at the end, after everything that is in flight."""
        if not self.connection.is_cut:
            self._put(callback)

    def clear(self) -> None:
        """Lose what is in flight."""
        self._queue.clear()

    def cut(self, *, keep: bool) -> None:
        """End the connection; what is in flight is lost unless `keep` is true."""
        if not keep:
            self.clear()
        self._put(self._end.end)

    def heal(self) -> None:
        """Let everything pass again."""
        if self._death is not None:
            self._death.cancel()
            self._death = None
        self._set_timer()

    def close(self) -> None:
        """Stop all timers: the end has vanished."""
        self.clear()
        for timer in (self._timer, self._death):
            if timer is not None:
                timer.cancel()
        self._timer = self._death = None

    def _put(self, callback: Callable[[], object]) -> None:
        self._last = max(self._last, self._loop.time() + self._lag())
        self._queue.append((self._last, callback))
        if self._timer is None:
            self._set_timer()

    def _lag(self) -> float:
        return self.connection.faults.lag(self._source, self._target)

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._queue:
            context = self._end.context
            self._timer = self._loop.call_at(self._queue[0][0], self._deliver, context=context)

    def _deliver(self) -> None:
        self._timer = None
        while self._queue and self._queue[0][0] <= self._loop.time():
            if self.is_silent:
                self.connection.faults.happened["silences"] += 1
                return  # `heal` continues
            _, callback = self._queue.popleft()
            callback()
        self._set_timer()

    def _expect_death(self) -> None:
        sender = cast("FaultyPipe", self._end.peer)
        if self._death is None:
            wait = self.connection.faults.dead_after or sender.keepalive_timeout
            self._death = sender.loop.call_later(wait, self._die, sender, context=sender.context)

    def _die(self, sender: FaultyPipe) -> None:
        self._death = None
        self.connection.faults.happened["deaths"] += 1
        sender.die()


class FaultyConnection:
    """A connection between two programs."""

    def __init__(
        self,
        faults: NetworkFaults,
        caller: str,
        called: str,
        client: FaultyPipe,
        server: FaultyPipe,
    ) -> None:
        self.faults = faults
        self.caller, self.called = caller, called
        self.is_cut = False
        self._bytes_left = faults.lifetime(self)
        self._ends = (client, server)
        client.peer, server.peer = server, client
        client.incoming = Direction(self, called, caller, client)
        server.incoming = Direction(self, caller, called, server)

    @property
    def is_silent(self) -> bool:
        """Whether no acknowledgement can arrive, because one direction is silent."""
        return any(end.incoming.is_silent for end in self._ends)

    def spare(self) -> None:
        """Do not cut the connection any more."""
        self._bytes_left = math.inf

    def spend(self, count: int) -> int:
        """Return how many of `count` bytes still pass."""
        passing = int(min(count, max(0.0, self._bytes_left)))
        self._bytes_left -= count
        return passing

    def cut(self, *, keep: bool = False) -> None:
        """Let both ends lose the connection."""
        if not self.is_cut:
            self.is_cut = True
            self.faults.was_cut(self)
            for end in self._ends:
                end.incoming.cut(keep=keep)

    def crash(self, program: str) -> None:
        """Remove the ends of a killed program; the other ends are reset."""
        for end in self._ends:
            if program == (self.caller if end is self._ends[0] else self.called):
                end.vanish()
                cast("FaultyPipe", end.peer).reset()
        self.end_lost()

    def heal(self) -> None:
        """Let everything pass again."""
        for end in self._ends:
            end.incoming.heal()

    def end_lost(self) -> None:
        """Forget the connection once both ends have lost it."""
        if all(end.is_lost for end in self._ends):
            for end in self._ends:
                end.incoming.close()
            self.faults.connections.pop(self, None)
