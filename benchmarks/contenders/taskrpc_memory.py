"""taskrpc within one event loop: no sockets, and everything else of a call."""

from __future__ import annotations

import taskrpc
from benchmarks.contenders.taskrpc_tcp import caller, offer
from benchmarks.harness.contender import Caller


async def connect(place: str, options: list[str]) -> Caller:
    server = taskrpc.Node("server", transport="memory")
    client = taskrpc.Node("caller", transport="memory")
    await server.start()
    await client.start()
    offer(server, options)
    return await caller(client)
