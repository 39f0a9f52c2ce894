"""The contract suite runs in memory on virtual time, and over TCP on the machine's clock."""

from __future__ import annotations

import asyncio
import contextlib
import itertools

import pytest

import taskrpc
from taskrpc.program import fast_loop
from taskrpc.testing import VirtualTimeLoop

CONTRACT = "_contract"
"""Part of the names of the test files that every transport must pass."""


def pytest_asyncio_loop_factories(config, item):
    """Return a transport for each loop; with uvloop too if it is installed."""
    if CONTRACT not in item.path.name:
        return None
    loops = {"memory": VirtualTimeLoop, "tcp": asyncio.SelectorEventLoop}
    if (uvloop := fast_loop()) is not None:
        loops["tcp on uvloop"] = uvloop
    return loops


def pytest_collection_modifyitems(items):
    for item in items:
        if CONTRACT in item.path.name and "tcp" in item.name:
            item.add_marker(pytest.mark.real_time)


class Network:
    """Creates nodes that are destroyed with the test; each has its own sockets by default."""

    def __init__(self, stack):
        self.is_virtual = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        self.transport = "memory" if self.is_virtual else "tcp"
        self._stack = stack
        self._count = itertools.count()

    async def node(self, name="server", *, shared=False, **options):
        # Nodes with different settings do not share an endpoint.
        options.setdefault("token", "shared" if shared else f"{name} {next(self._count)}")
        node = taskrpc.Node(name, transport=self.transport, **options)
        return await self._stack.enter_async_context(node)

    async def client(self, srv_type, name, *, node="client", **options):
        return (await self.node(node)).create_client(srv_type, name, **options)


@pytest.fixture
async def net():
    async with contextlib.AsyncExitStack() as stack:
        yield Network(stack)
