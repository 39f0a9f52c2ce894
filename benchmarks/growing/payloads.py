"""Bytes to a server and back, beside an echo of bare asyncio, which shows what the machine does."""

from __future__ import annotations

import taskrpc
from benchmarks.contenders import raw_asyncio
from benchmarks.contenders.taskrpc_tcp import Echo
from benchmarks.growing import server, timing


async def sample(size: int, seconds: float) -> dict[str, float]:
    """Echo `size` bytes, one call after the other."""
    data = bytes(size)
    async with server.started(), taskrpc.Node("caller") as node:
        client = node.create_client(Echo, "echo")
        p50 = await _p50(lambda: client.call(Echo.Request(data=data)), seconds)
    async with server.started("raw") as other:
        caller = await raw_asyncio.connect(other.place, [])
        raw = await _p50(lambda: caller.echo(data), seconds)
    return {"echo": p50, "throughput": 2 * size / p50, "raw": raw, "ratio": p50 / raw}


async def _p50(call: timing.Call, seconds: float) -> float:
    await timing.latency(call, seconds / 2)
    return (await timing.latency(call, 2 * seconds))["p50"]
