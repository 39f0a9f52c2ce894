"""The load: calls one after the other, in as many loops at a time as calls shall be in flight."""

from __future__ import annotations

import asyncio
import inspect
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from benchmarks.harness.contender import TWO_INTS, Caller
from benchmarks.harness.quantiles import quantile

Sample = dict[str, float]
"""`calls`, and in seconds: `elapsed`, `p50`, `p99`, `cpu` (of the calling process)."""


class Load:
    """Loads one contender, whether it is async or blocks.

    `connect` makes a further caller for a thread of its own; None where threads share the first.
    """

    def __init__(self, caller: Caller, connect: Callable[[], Caller] | None) -> None:
        self._caller = caller
        self._connect = connect
        self._threads: dict[int, ThreadPoolExecutor] = {}
        self._own = threading.local()
        self._is_async = False

    async def check(self, *, typed: bool) -> None:
        """See that the contender does what it is measured for; raises RuntimeError if not."""
        caller = self._caller
        data = bytes(range(256))
        answer = caller.echo(data)
        self._is_async = inspect.isawaitable(answer)
        if caller.data_in(await _settled(answer)) != data:
            raise RuntimeError("the echo is wrong")
        if typed and caller.sum_in(await _settled(caller.add(*TWO_INTS))) != sum(TWO_INTS):
            raise RuntimeError("the sum is wrong")

    async def run(self, *, payload: int, in_flight: int, seconds: float) -> Sample:
        """Call for so long; `payload` bytes are echoed, with 0 two integers are added."""
        data = bytes(payload)
        took: deque[float] = deque()
        begin, cpu = time.perf_counter(), time.process_time()
        if self._is_async:
            await _in_tasks(_call(self._caller, data), in_flight, seconds, took)
        elif in_flight == 1:
            _in_turn(_call(self._caller, data), seconds, took)
        else:
            begin = self._in_threads(data, in_flight, seconds, took)
        elapsed, cpu = time.perf_counter() - begin, time.process_time() - cpu
        return {"elapsed": elapsed, "cpu": cpu, **_summary(took)}

    def _in_threads(self, data: bytes, in_flight: int, seconds: float, took: deque[float]) -> float:
        """Call in threads of their own; returns when they began, all of them connected."""
        if in_flight not in self._threads:
            self._threads[in_flight] = ThreadPoolExecutor(in_flight)
        barrier = threading.Barrier(in_flight + 1)

        def work() -> None:
            call = _call(self._callers_own(), data)
            barrier.wait()
            _in_turn(call, seconds, took)

        futures = [self._threads[in_flight].submit(work) for _ in range(in_flight)]
        barrier.wait()
        begin = time.perf_counter()
        for future in futures:
            future.result()
        return begin

    def _callers_own(self) -> Caller:
        if self._connect is None:
            return self._caller
        if not hasattr(self._own, "caller"):
            self._own.caller = self._connect()
        caller: Caller = self._own.caller
        return caller


async def _settled(answer: Any) -> Any:
    return await answer if inspect.isawaitable(answer) else answer


def _call(caller: Caller, data: bytes) -> Callable[[], Any]:
    if data:
        return lambda: caller.echo(data)
    return lambda: caller.add(*TWO_INTS)


async def _in_tasks(
    call: Callable[[], Any], in_flight: int, seconds: float, took: deque[float]
) -> None:
    clock = time.perf_counter
    end = clock() + seconds

    async def work() -> None:
        begin = clock()
        while True:
            await call()
            now = clock()
            took.append(now - begin)
            if now >= end:
                return
            begin = now

    if in_flight == 1:
        await work()
    else:
        await asyncio.gather(*(work() for _ in range(in_flight)))


def _in_turn(call: Callable[[], Any], seconds: float, took: deque[float]) -> None:
    clock = time.perf_counter
    begin = clock()
    end = begin + seconds
    while begin < end:
        call()
        now = clock()
        took.append(now - begin)
        begin = now


def _summary(took: deque[float]) -> Sample:
    return {"calls": len(took), "p50": quantile(took, 0.5), "p99": quantile(took, 0.99)}
