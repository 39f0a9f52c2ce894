"""taskrpc as in its README, everything at its defaults: a deadline on every call, limits, lookup.

The option `async` makes the callbacks async, `once` makes the services exactly-once, in memory.
"""

from __future__ import annotations

import asyncio
import os
from typing import Any

import srvgen
import taskrpc
from benchmarks.harness.contender import Announce, Caller

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
Echo = srvgen.load("bench_interfaces/srv/Echo")


def add(request: Any, response: Any) -> Any:
    response.sum = request.a + request.b
    return response


def echo(request: Any, response: Any) -> Any:
    response.data = request.data
    return response


async def add_async(request: Any, response: Any) -> Any:
    return add(request, response)


async def echo_async(request: Any, response: Any) -> Any:
    return echo(request, response)


def offer(node: taskrpc.Node, options: list[str]) -> None:
    """Offer both services."""
    is_async = "async" in options
    store = taskrpc.MemoryCompletions() if "once" in options else None
    node.create_service(Add, "add", add_async if is_async else add, exactly_once=store)
    node.create_service(Echo, "echo", echo_async if is_async else echo, exactly_once=store)


async def serve(announce: Announce, options: list[str]) -> None:
    async with taskrpc.Node("server") as node:
        offer(node, options)
        announce(node.address)
        await asyncio.get_running_loop().create_future()


async def connect(place: str, options: list[str]) -> Caller:
    node = taskrpc.Node("caller")
    await node.start()
    return await caller(node)


async def caller(node: taskrpc.Node) -> Caller:
    """A caller of both services."""
    adder, echoer = node.create_client(Add, "add"), node.create_client(Echo, "echo")
    for client in (adder, echoer):
        if not await client.wait_for_service(timeout=10):
            raise RuntimeError(f"{client.service_name} is not there")
    return Caller(
        add=lambda a, b: adder.call(Add.Request(a=a, b=b)),
        echo=lambda data: echoer.call(Echo.Request(data=data)),
        sum_in=lambda response: response.sum,
        data_in=lambda response: response.data,
    )


class _Idle(asyncio.Protocol):
    """A connection that shakes hands, answers pings and calls nothing."""

    def __init__(self, token: bytes) -> None:
        import secrets  # costs a server's start more than a tenth of its event loop

        from taskrpc.core.wire.handshake import Identity
        from taskrpc.core.wire.session import Session

        me = Identity(
            secrets.token_bytes(16),
            secrets.token_bytes(16),
            token,
            domain=int(os.environ["ROS_DOMAIN_ID"]),
            name="/idle",
        )
        self._session = Session(me, is_client=True)
        self.ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        self._write()

    def data_received(self, data: bytes) -> None:
        from taskrpc.core.wire.events import Ready

        events = self._session.feed(data)
        if any(isinstance(event, Ready) for event in events):
            self.ready.set_result(None)
        self._write()

    def connection_lost(self, exc: Exception | None) -> None:
        if not self.ready.done():
            self.ready.set_exception(ConnectionError("lost in the handshake"))

    def _write(self) -> None:
        if self._session.out:
            self._transport.write(b"".join(self._session.take()))


async def connect_idle(place: str) -> asyncio.BaseTransport:
    """Open a connection that is ready for calls and makes none."""
    loop = asyncio.get_running_loop()
    host, port = place.split(":")
    token = bytes.fromhex(_token_of(place))
    transport, protocol = await loop.create_connection(lambda: _Idle(token), host, int(port))
    await protocol.ready
    return transport


_tokens: dict[str, str] = {}


def _token_of(place: str) -> str:
    """The secret of the server, from the registry."""
    from taskrpc.core.transport.discovery.registry import Registry

    if place not in _tokens:
        entries = Registry(int(os.environ["ROS_DOMAIN_ID"])).entries()
        _tokens.update({entry.address: entry.token for entry in entries})
    return _tokens[place]
