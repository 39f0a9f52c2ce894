"""One publisher and many subscriptions over TCP, beside bare asyncio that does the least."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import Any

import srvgen
import taskrpc
from benchmarks.growing import timing

_SIZE = 32
_FRAME = 52
"""Bytes of a message of 32 characters on the wire, its header included."""


class _Counter:
    """Counts what came, and wakes who waits for a number of it."""

    def __init__(self) -> None:
        self._count = 0
        self._wanted = 0
        self._done: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def expect(self, more: int) -> asyncio.Future[None]:
        self._wanted, self._count = more, 0
        self._done = asyncio.get_running_loop().create_future()
        return self._done

    def came(self, _: Any = None) -> None:
        self._count += 1
        if self._count == self._wanted:
            self._done.set_result(None)


async def sample(size: int, seconds: float) -> dict[str, float]:
    """A message to `size` subscriptions, one after the other, and as many as go."""
    async with _topic(size) as (publish, counter):
        p50 = await _p50(publish, counter, size, seconds)
        rate = await timing.rate(lambda: _once(publish, counter, size), seconds, in_flight=1)
    async with _raw(size) as (write, raw_counter):
        raw = await _p50(write, raw_counter, size, seconds)
    return {"deliver": p50 / size, "rate": rate * size, "raw": raw / size, "ratio": p50 / raw}


async def _p50(send: Callable[[], object], counter: _Counter, size: int, seconds: float) -> float:
    await timing.latency(lambda: _once(send, counter, size), seconds / 2)
    return (await timing.latency(lambda: _once(send, counter, size), seconds))["p50"]


async def _once(send: Callable[[], object], counter: _Counter, size: int) -> None:
    done = counter.expect(size)
    send()
    await done


@contextlib.asynccontextmanager
async def _topic(size: int) -> AsyncIterator[tuple[Callable[[], object], _Counter]]:
    """Everybody in this process, each subscription on a connection of its own."""
    string = srvgen.load("std_msgs/msg/String")
    counter, matched = _Counter(), asyncio.Event()
    async with contextlib.AsyncExitStack() as stack:
        talker = await stack.enter_async_context(taskrpc.Node("talker", token="talker"))
        publisher = talker.create_publisher(string, "text", 100)
        publisher.on_matched = matched.set
        for number in range(size):
            node = taskrpc.Node("listener", token=f"listener {number}")
            await stack.enter_async_context(node)
            node.create_subscription(string, "text", counter.came, 100)
        while publisher.get_subscription_count() < size:
            matched.clear()
            await matched.wait()
        message = string(data="x" * _SIZE)
        yield lambda: publisher.publish(message), counter


@contextlib.asynccontextmanager
async def _raw(size: int) -> AsyncIterator[tuple[Callable[[], object], _Counter]]:
    """As many connections, and the same frame written to each."""
    counter, loop = _Counter(), asyncio.get_running_loop()
    accepted: list[asyncio.WriteTransport] = []
    all_accepted = counter.expect(size)
    server = await loop.create_server(lambda: _RawEnd(counter, accepted), "127.0.0.1", 0)
    place = server.sockets[0].getsockname()
    clients = [
        (await loop.create_connection(lambda: _RawEnd(counter), *place))[0] for _ in range(size)
    ]
    await all_accepted
    frame = b"x" * _FRAME

    def write() -> None:
        for each in accepted:
            each.write(frame)

    try:
        yield write, counter
    finally:
        for client in clients:
            client.close()
        server.close()
        await server.wait_closed()


class _RawEnd(asyncio.Protocol):
    def __init__(
        self, counter: _Counter, accepted: list[asyncio.WriteTransport] | None = None
    ) -> None:
        self._accepted, self._counter = accepted, counter
        self._rest = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if self._accepted is not None:
            assert isinstance(transport, asyncio.WriteTransport)
            self._accepted.append(transport)
            self._counter.came()

    def data_received(self, data: bytes) -> None:
        count, self._rest = divmod(self._rest + len(data), _FRAME)
        for _ in range(count):
            self._counter.came()
