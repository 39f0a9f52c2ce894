"""Clocks and loads that the topics share."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from benchmarks.harness.quantiles import quantile

Call = Callable[[], Awaitable[Any]]


def microseconds(action: Callable[[Any], object], items: list[Any]) -> float:
    """The mean time of an action on each of these."""
    began = time.perf_counter()
    for item in items:
        action(item)
    return (time.perf_counter() - began) / len(items) * 1e6


async def microseconds_async(action: Callable[[Any], Awaitable[Any]], items: list[Any]) -> float:
    """The same for an action that is awaited."""
    began = time.perf_counter()
    for item in items:
        await action(item)
    return (time.perf_counter() - began) / len(items) * 1e6


async def latency(call: Call, seconds: float) -> dict[str, float]:
    """Call one after the other; `p50` and `p99` in microseconds."""
    spent: list[float] = []
    end = time.perf_counter() + seconds
    while (began := time.perf_counter()) < end or len(spent) < 5:
        await call()
        spent.append((time.perf_counter() - began) * 1e6)
    spent.sort()
    return {"p50": quantile(spent, 0.5), "p99": quantile(spent, 0.99)}


async def rate(call: Call, seconds: float, in_flight: int = 64) -> float:
    """Calls a second with so many in flight."""
    done = 0
    began = time.perf_counter()
    end = began + seconds

    async def caller() -> None:
        nonlocal done
        while time.perf_counter() < end:
            await call()
            done += 1

    await asyncio.gather(*(caller() for _ in range(in_flight)))
    return done / (time.perf_counter() - began)
