"""An endpoint notifies callers once in a turn, and connects to no process once it is closed."""

import asyncio

import pytest

import taskrpc
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
