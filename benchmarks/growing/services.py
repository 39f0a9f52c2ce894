"""A process with many services, and as many clients in it."""

from __future__ import annotations

import itertools
import random
from typing import Any

import taskrpc
from benchmarks.contenders.taskrpc_tcp import Add, add
from benchmarks.growing import timing
from benchmarks.growing.memory import memory_each
from benchmarks.harness import usage

_USED = 256
"""Services that are called, at most."""


async def sample(size: int, seconds: float) -> dict[str, float]:
    """`size` services and clients, made, called and destroyed."""
    names = [f"s{number}" for number in range(size)]
    async with taskrpc.Node("server") as node:
        await _warm_up(node, seconds)
        before = usage.memory()
        services: list[Any] = []
        clients: list[Any] = []
        found = {
            "create_service": timing.microseconds(
                lambda name: services.append(node.create_service(Add, name, add)), names
            ),
        }
        found["memory"] = memory_each(usage.memory() - before, size)
        found["create_client"] = timing.microseconds(
            lambda name: clients.append(node.create_client(Add, name)), names
        )
        used = random.Random(1).sample(clients, min(size, _USED))
        found["first_call"] = await timing.microseconds_async(_call, used)
        turns = itertools.cycle(used)
        found["rate"] = await timing.rate(lambda: _call(next(turns)), seconds)
        found["destroy_client"] = timing.microseconds(lambda client: client.destroy(), clients)
        found["destroy_service"] = timing.microseconds(lambda each: each.destroy(), services)
    return found


def _call(client: taskrpc.Client) -> Any:
    return client.call(Add.Request(a=1, b=2))


async def _warm_up(node: taskrpc.Node, seconds: float) -> None:
    service, client = node.create_service(Add, "first", add), node.create_client(Add, "first")
    await timing.rate(lambda: _call(client), seconds / 2)
    client.destroy()
    service.destroy()
