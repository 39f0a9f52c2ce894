"""Programs that a memory engine connects."""

from __future__ import annotations

import contextlib

import pytest

import taskrpc
from taskrpc.core.transport import shared_endpoint
from taskrpc.core.transport.shared_endpoint import Registration
from taskrpc.testing.memory_engine import MemoryEngine, bus_of


class Programs:
    """Starts nodes with an endpoint each, and foreign programs; ends them with the test."""

    def __init__(self, stack):
        self._stack = stack
        self.bus = bus_of(0)

    async def node(self, name, **settings):
        node = taskrpc.Node(name, transport="tunnel", listen=name, **settings)
        return await self._stack.enter_async_context(node)

    async def foreign(self):
        """Return the engine of a program that is not taskrpc's."""
        engine = MemoryEngine(0)
        await engine.open(engine.events)
        self._stack.callback(engine.close)
        return engine

    def vanish(self, node):
        """Take a program off the bus without a word, as if it were killed."""
        engine = node._transport.network._engine
        engine.send = lambda place, datagram: None
        engine.close()


@pytest.fixture
async def programs(monkeypatch):
    opener = "taskrpc.testing.memory_engine:open_network"
    monkeypatch.setitem(shared_endpoint.TRANSPORTS, "tunnel", Registration(opener))
    async with contextlib.AsyncExitStack() as stack:
        yield Programs(stack)
