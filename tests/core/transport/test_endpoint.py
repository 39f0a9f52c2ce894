"""Callers are notified of changed services once in a turn, for any number of changes."""

import asyncio

import taskrpc
from taskrpc.core.wire.session import Session
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
