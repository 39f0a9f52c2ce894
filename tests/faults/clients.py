"""Clients in one process with their server, each with a connection of its own."""

from __future__ import annotations

import contextlib

import taskrpc
from tests.core.transport.helpers import Add


@contextlib.asynccontextmanager
async def clients_of(callback, count, **options):
    """Clients of one service, each with its own connection."""
    async with contextlib.AsyncExitStack() as stack:
        server = taskrpc.Node("server", transport="memory", token="s")
        await stack.enter_async_context(server)
        server.create_service(Add, "add", callback, **options)
        clients = []
        for number in range(count):
            node = taskrpc.Node("client", transport="memory", token=f"c{number}")
            await stack.enter_async_context(node)
            clients.append(node.create_client(Add, "add"))
            assert await clients[-1].wait_for_service(5)
        yield clients
