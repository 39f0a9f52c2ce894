"""Nodes for a test: started, connected in memory, gone at its end."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

from taskrpc.node import Node


@contextlib.asynccontextmanager
async def connected_nodes(*names: str) -> AsyncIterator[tuple[Node, ...]]:
    """Started nodes of these names, which see each other and nobody else.

    They live in memory, so a test needs no sockets, and may run in virtual time:
    `async with connected_nodes("server", "client") as (server, client):`.
    """
    async with contextlib.AsyncExitStack() as nodes:
        yield tuple(
            [await nodes.enter_async_context(Node(name, transport="memory")) for name in names]
        )
