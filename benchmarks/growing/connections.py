"""A server with many connections: idle ones beside one that calls, or all of them calling."""

from __future__ import annotations

import asyncio
import os
import secrets
import time
from typing import Any

import taskrpc
from benchmarks.contenders.taskrpc_tcp import Add, connect_idle
from benchmarks.growing import server, timing
from benchmarks.growing.memory import memory_each
from taskrpc.core.transport.codec import codec_of
from taskrpc.core.transport.discovery.registry import Registry
from taskrpc.core.wire.events import Ready, ResponseReceived
from taskrpc.core.wire.frames import NO_DEADLINE
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.messages import Resolve, decode_resolved
from taskrpc.core.wire.session import Session

_AT_A_TIME = 50
_BODY = codec_of(Add.Request).encode(Add.Request(a=1, b=2))


async def sample(size: int, seconds: float) -> dict[str, float]:
    """`size` idle connections, then as many that call."""
    async with server.started() as other:
        idle = await _idle(other, size, seconds)
    async with server.started() as other:
        return {**idle, **await _active(other, size, seconds)}


async def _idle(other: server.Server, size: int, seconds: float) -> dict[str, float]:
    async with taskrpc.Node("caller") as node:
        client = node.create_client(Add, "add")
        call = lambda: client.call(Add.Request(a=1, b=2))  # noqa: E731
        await timing.rate(call, seconds / 2)
        before = await other.memory()
        held = [await connect_idle(other.place) for _ in range(size)]
        memory = await other.memory() - before
        slow = await timing.latency(call, seconds)
        rate = await timing.rate(call, seconds)
        for transport in held:
            transport.close()
    return {
        "idle_p50": slow["p50"],
        "idle_p99": slow["p99"],
        "idle_rate": rate,
        "idle_memory": memory_each(memory, size),
    }


async def _active(other: server.Server, size: int, seconds: float) -> dict[str, float]:
    loop = asyncio.get_running_loop()
    host, port = other.place.split(":")
    entries = Registry(int(os.environ["ROS_DOMAIN_ID"])).entries()
    token = next(entry.token for entry in entries if entry.address == other.place)
    callers = [_Caller(bytes.fromhex(token)) for _ in range(size)]

    async def connect(caller: _Caller) -> None:
        await loop.create_connection(lambda: caller, host, int(port))
        await caller.ready

    for start in range(0, size, _AT_A_TIME):
        await asyncio.gather(*map(connect, callers[start : start + _AT_A_TIME]))
    # Long enough for each connection to have several turns.
    end = time.perf_counter() + seconds + size / 1000
    began = time.perf_counter()
    await asyncio.gather(*(caller.call_until(end) for caller in callers))
    done = sum(caller.done for caller in callers)
    return {"active_rate": done / (time.perf_counter() - began)}


class _Caller(asyncio.Protocol):
    """A bare connection that makes one call after the other."""

    def __init__(self, token: bytes) -> None:
        nonces = secrets.token_bytes(16), secrets.token_bytes(16)
        domain = int(os.environ["ROS_DOMAIN_ID"])
        self._session = Session(Identity(*nonces, token, domain, "/caller"), is_client=True)
        self.done = 0
        self._end = 0.0
        self._method = 0
        loop = asyncio.get_running_loop()
        self.ready: asyncio.Future[None] = loop.create_future()
        self._over: asyncio.Future[None] = loop.create_future()

    async def call_until(self, end: float) -> None:
        """Call until then."""
        self._end = end
        self._call()
        self._write()
        await self._over

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        self._write()

    def data_received(self, data: bytes) -> None:
        for event in self._session.feed(data):
            if isinstance(event, Ready):
                self._session.resolve("resolve", Resolve("/add", Add._HASH, "/caller"))
            elif isinstance(event, ResponseReceived) and event.ticket == "resolve":
                self._method = decode_resolved(event.body).method
                self.ready.set_result(None)
            elif isinstance(event, ResponseReceived):
                self.done += 1
                self._call()
        self._write()

    def connection_lost(self, exc: Exception | None) -> None:
        for future in (self.ready, self._over):
            if not future.done():
                future.set_exception(ConnectionError("the server closed a connection"))

    def _call(self) -> None:
        if time.perf_counter() < self._end:
            self._session.request("add", self._method, _BODY, NO_DEADLINE)
        else:
            self._over.set_result(None)
            self._transport.close()

    def _write(self) -> None:
        if self._session.out and not self._transport.is_closing():
            self._transport.write(b"".join(self._session.take()))
