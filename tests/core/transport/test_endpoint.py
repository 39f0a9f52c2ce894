"""An endpoint notifies callers once in a turn, and connects to no process once it is closed."""

import asyncio
from collections import Counter
from unittest import mock

import pytest

import taskrpc
from taskrpc.core.transport.connection.connection import Connection
from taskrpc.core.transport.memory import hub_of
from taskrpc.core.wire.session import Session
from taskrpc.errors import ConnectionLost
from tests.core.transport.helpers import Add, add, ask


async def test_many_services_made_at_once_are_advertised_once(monkeypatch):
    said = []
    advertise = Session.advertise
    monkeypatch.setattr(Session, "advertise", lambda self: said.append(1) or advertise(self))
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "first", add)
        assert (await node.create_client(Add, "first").call(ask(1))).sum == 1
        said.clear()
        for number in range(100):
            server.create_service(Add, f"service{number}", add)
        late = node.create_client(Add, "service99")
        assert await late.wait_for_service(60)
        await asyncio.sleep(0.1)
        assert said == [1]


async def test_closed_endpoint_that_has_never_called_connects_to_no_process():
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "add", add)
        endpoint = node._transport
        (address,) = endpoint.network.locate("/add")
        await node.destroy()
        with pytest.raises(ConnectionLost, match="the node was destroyed"):
            await endpoint.dialler.connection(address, None)


async def test_checks_of_many_connections_are_spread_over_a_second(monkeypatch):
    checked = []
    tick = lambda connection, now: checked.append((connection, now))  # noqa: E731
    monkeypatch.setattr(Connection, "tick", tick)
    async with taskrpc.Node("server", transport="memory", token="t") as server:
        server.create_service(Add, "add", add)
        (listener,) = hub_of(0).listeners.values()
        for _ in range(40):
            listener.factory().connection_made(mock.MagicMock(spec=asyncio.Transport))
        await asyncio.sleep(2.5)
    assert len({connection for connection, _ in checked[:40]}) == 40
    first = checked[0][1]
    times = Counter(round(now - first, 3) for _, now in checked[:40])
    assert times == {0.0: 8, 0.2: 8, 0.4: 8, 0.6: 8, 0.8: 8}
