"""Connections that stay open without calls, in the requested number."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import ModuleType
from typing import Any

_AT_A_TIME = 50
"""Connections that are opened at the same time: a server's backlog is finite."""


async def hold_idle(
    module: ModuleType,
    command: Callable[[], Awaitable[Any]],
    answer: Callable[[Any], None],
) -> None:
    """Open and close connections until there are as many as each command requests."""
    place = (await command())["place"]
    connect = getattr(module, "connect_idle", _connect_plain)
    held: list[asyncio.BaseTransport] = []
    answer({"held": 0})
    while order := await command():
        while len(held) < order["count"]:
            more = min(_AT_A_TIME, order["count"] - len(held))
            held += await asyncio.gather(*(connect(place) for _ in range(more)))
        for transport in held[order["count"] :]:
            transport.close()
        del held[order["count"] :]
        answer({"held": len(held)})


async def _connect_plain(place: str) -> asyncio.BaseTransport:
    host, port = place.split(":")
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_connection(asyncio.Protocol, host, int(port))
    return transport
