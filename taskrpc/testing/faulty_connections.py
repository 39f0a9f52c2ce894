"""The connections of a faulty network: what is sent arrives later, in pieces, or never."""

from __future__ import annotations

import asyncio
import contextvars
import math
import random
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import cast

from taskrpc.transport.connection.connection import Connection
from taskrpc.transport.memory import Listener, Pipe


class Links:
    """The wires of a network, and what chance makes of them; the `Conditions` of its hub."""

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
        self.silent: set[tuple[str, str]] = set()
        """Ways from program to program on which nothing passes."""
        self.healed = asyncio.Event()
        self.wires: dict[Wire, None] = {}
        self._chance = random.Random(seed)
        self._delay = delay
        self._pieces = pieces
        self._cut_after = cut_after
        self._refuse = refuse

    async def connect(self, caller: str, listener: Listener) -> None:
        """Return once a listener has heard of a caller. Raises ConnectionRefusedError."""
        await asyncio.sleep(self.lag())
        while {(caller, listener.program), (listener.program, caller)} & self.silent:
            await self.healed.wait()
        if self._chance.random() < self._refuse:
            self.happened["refusals"] += 1
            raise ConnectionRefusedError("the network refused the connection")

    def join(
        self, client: asyncio.BufferedProtocol, caller: str, listener: Listener, name: str
    ) -> None:
        """Connect a client with a new connection of a listener."""
        self.happened["connections"] += 1
        context = listener.context
        server = context.run(listener.factory)
        one = End(client, name, contextvars.copy_context())
        other = End(server, f"a client of {name}", context)
        self.wires[Wire(self, caller, listener.program, one, other)] = None
        context.run(server.connection_made, other)
        client.connection_made(one)

    def lag(self) -> float:
        """How long the next bytes are on their way."""
        return self._chance.uniform(*self._delay)

    def cut_up(self, data: bytes) -> list[bytes]:
        """What is sent, in the pieces in which it arrives."""
        found, begin = [], 0
        while begin < len(data):
            size = self._chance.randint(1, self._pieces) if self._pieces else len(data)
            found.append(data[begin : begin + size])
            begin += size
        return found

    def lifetime(self) -> float:
        """Bytes until a new connection is cut."""
        return self._chance.expovariate(1 / self._cut_after) if self._cut_after else math.inf


class End(Pipe):
    """One end of a wire; all that happens at it happens in its own program's context."""

    way: Way
    """By which things come here."""

    def __init__(
        self, protocol: asyncio.BufferedProtocol, name: str, context: contextvars.Context
    ) -> None:
        super().__init__(protocol, name)
        self.context = context

    def arrived(self, piece: bytes) -> None:
        """Bytes have come through."""
        if self._lost:
            self.peer._reset()
        else:
            self._inbox.append(memoryview(piece))
            self._plan_delivery()

    def end(self) -> None:
        """The connection is cut after what has come through."""
        super()._end()

    def die(self) -> None:
        """The system gives the connection up."""
        self._closing = True
        self._lose()

    def vanish(self) -> None:
        """Nobody is here any more who could be told anything."""
        self._closing = self._lost = True
        self.way.close()

    @property
    def patience(self) -> float:
        """Seconds for which the system waits for an acknowledgement."""
        return cast("Connection", self._protocol).owner.keepalive.dead_after

    @property
    def is_lost(self) -> bool:
        """Whether nobody is here any more."""
        return self._lost

    def _receive(self, data: bytes) -> None:
        self._inbox_size += len(data)  # on its way, it is unread as well
        self.way.send(data)

    def _end(self) -> None:
        self.way.put(super()._end)

    def _reset(self) -> None:
        if not self.way.wire.is_cut:  # else the end is on its way already
            self.way.clear()
            self.way.put(super()._reset)

    def _plan_delivery(self) -> None:
        if not self._delivery_planned:
            self._delivery_planned = True
            self._loop.call_soon(self._deliver, context=self.context)

    def _caught_up(self) -> None:
        self._loop.call_soon(super()._caught_up, context=self.context)

    def _lose(self) -> None:
        if not self._lost:
            super()._lose()
            self.way.wire.lost()


class Way:
    """One direction of a wire: keeps the order, and what cannot pass now."""

    def __init__(self, wire: Wire, source: str, target: str, end: End) -> None:
        self.wire = wire
        self._source, self._target = source, target
        self._end = end
        self._loop = asyncio.get_running_loop()
        self._queue: deque[tuple[float, Callable[[], object]]] = deque()
        self._last = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self._death: asyncio.TimerHandle | None = None

    @property
    def is_silent(self) -> bool:
        """Whether nothing passes."""
        return (self._source, self._target) in self.wire.links.silent

    def send(self, data: bytes) -> None:
        """Let bytes come through, as many as the wire lives for."""
        passing = self.wire.spend(len(data))
        for piece in self.wire.links.cut_up(data[:passing]):
            self.put(partial(self._end.arrived, piece))
        if passing < len(data):
            self.wire.cut(keep=True)
        elif self.wire.is_silent:
            self._expect_death()

    def put(self, what: Callable[[], object]) -> None:
        """Let something happen at the end after what is on its way."""
        if not self.wire.is_cut:
            self._put(what)

    def clear(self) -> None:
        """Forget what is on its way."""
        self._queue.clear()

    def cut(self, *, keep: bool) -> None:
        """Nothing comes after this, nor what is on its way unless it is kept."""
        if not keep:
            self.clear()
        self._put(self._end.end)

    def go_on(self) -> None:
        """Everything passes again."""
        if self._death is not None:
            self._death.cancel()
            self._death = None
        self._arm()

    def close(self) -> None:
        """Nobody is at the end."""
        self.clear()
        for timer in (self._timer, self._death):
            if timer is not None:
                timer.cancel()
        self._timer = self._death = None

    def _put(self, what: Callable[[], object]) -> None:
        self._last = max(self._last, self._loop.time() + self.wire.links.lag())
        self._queue.append((self._last, what))
        if self._timer is None:
            self._arm()

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._queue:
            context = self._end.context
            self._timer = self._loop.call_at(self._queue[0][0], self._come, context=context)

    def _come(self) -> None:
        self._timer = None
        while self._queue and self._queue[0][0] <= self._loop.time():
            if self.is_silent:
                self.wire.links.happened["silences"] += 1
                return  # until `go_on`
            _, what = self._queue.popleft()
            what()
        self._arm()

    def _expect_death(self) -> None:
        sender = cast("End", self._end.peer)
        if self._death is None:
            wait = self.wire.links.dead_after or sender.patience
            self._death = self._loop.call_later(wait, self._die, sender, context=sender.context)

    def _die(self, sender: End) -> None:
        self._death = None
        self.wire.links.happened["deaths"] += 1
        sender.die()


class Wire:
    """A connection between two programs."""

    def __init__(self, links: Links, caller: str, called: str, client: End, server: End) -> None:
        self.links = links
        self.caller, self.called = caller, called
        self.is_cut = False
        self._left = links.lifetime()
        self._ends = (client, server)
        client.peer, server.peer = server, client
        client.way = Way(self, called, caller, client)
        server.way = Way(self, caller, called, server)

    @property
    def is_silent(self) -> bool:
        """Whether no acknowledgement can come, in whichever direction bytes are lost."""
        return any(end.way.is_silent for end in self._ends)

    def spend(self, count: int) -> int:
        """How many of so many bytes still pass."""
        passing = int(min(count, max(0.0, self._left)))
        self._left -= count
        return passing

    def cut(self, *, keep: bool = False) -> None:
        """Both ends find the connection lost."""
        if not self.is_cut:
            self.is_cut = True
            self.links.happened["cuts"] += 1
            for end in self._ends:
                end.way.cut(keep=keep)

    def crash(self, program: str) -> None:
        """The ends of a program are gone without a word; the others find themselves reset."""
        for end in self._ends:
            if program == (self.caller if end is self._ends[0] else self.called):
                end.vanish()
                end.peer._reset()
        self.lost()

    def go_on(self) -> None:
        """Everything passes again."""
        for end in self._ends:
            end.way.go_on()

    def lost(self) -> None:
        """An end is gone; with both, the wire is."""
        if all(end.is_lost for end in self._ends):
            for end in self._ends:
                end.way.close()
            self.links.wires.pop(self, None)
