"""Bytes to a server and back."""

from __future__ import annotations

import taskrpc
from benchmarks.contenders.taskrpc_tcp import Echo
from benchmarks.growing import server, timing


async def sample(size: int, seconds: float) -> dict[str, float]:
    """Echo `size` bytes, one call after the other."""
    data = bytes(size)
    async with server.started(), taskrpc.Node("caller") as node:
        client = node.create_client(Echo, "echo")
        call = lambda: client.call(Echo.Request(data=data))  # noqa: E731
        await timing.latency(call, seconds / 2)
        p50 = (await timing.latency(call, 2 * seconds))["p50"]
    return {"echo": p50, "throughput": 2 * size / p50}
