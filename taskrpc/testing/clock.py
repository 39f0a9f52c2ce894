"""An event loop in virtual time: its clock jumps instead of waiting."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import selectors
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import Any, TypeVar, TypeVarTuple

_Args = TypeVarTuple("_Args")
_Result = TypeVar("_Result")

_FIRST_DAY = 1_767_225_600.0  # 2026-01-01 00:00 UTC, in seconds since 1970
_EXECUTOR_TIMEOUT = 30.0  # real seconds after which a job in a thread counts as stuck


class NothingWillEverHappen(RuntimeError):
    """A program on a `VirtualTimeLoop` waits, and no timer or job exists that could wake it."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock jumps to the next timer instead of waiting for it.

    Hours of timeouts, backoff and robot motion take milliseconds, and every timer fires exactly at
    its time. `loop.time()` starts at 0.0 seconds. The clock stands still while a job runs in an
    executor. A wait that nothing can end raises `NothingWillEverHappen` instead of hanging.

    `seed` determines everything random in the library: waits, ids and secrets. The time of day
    that the library uses then begins at 2026-01-01 00:00 UTC, and passes as the loop's clock does.
    The same program with the same seed runs in the same way each time, in every process. With None,
    each run differs. Not part of it: the program's own random numbers, threads and uses of `time`.
    """

    def __init__(self, seed: int | None = None) -> None:
        self._virtual_now = 0.0
        if seed is not None:
            self.chance = random.Random(seed)
            """See `taskrpc.core.transport.chance`."""
            self.time_of_day = lambda: _FIRST_DAY + self._virtual_now
            """See `taskrpc.core.transport.time_of_day`."""
        self._open_jobs = 0  # in executors
        super().__init__(_JumpingSelector(self))
        self.advance(0.0)

    def time(self) -> float:
        """The virtual time in seconds."""
        return self._virtual_now

    def advance(self, seconds: float) -> None:
        """Move the clock forward; timers that are due then fire in the loop's next turn."""
        self._virtual_now += seconds
        # asyncio fires a timer up to one clock resolution early. A coroutine that then waits for
        # the rest of the time would be woken at the same instant for ever, because this clock
        # moves only while nothing runs. So the resolution is the smallest possible one.
        self._clock_resolution = math.ulp(self._virtual_now)

    @property
    def has_open_jobs(self) -> bool:
        """Whether a job runs in an executor, so that the clock must stand still."""
        return self._open_jobs > 0

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[*_Args], _Result], *args: *_Args
    ) -> asyncio.Future[_Result]:
        """Run `func` in a thread while the clock stands still."""
        self._open_jobs += 1
        future = super().run_in_executor(executor, func, *args)
        future.add_done_callback(self._job_closed)
        return future

    async def shutdown_default_executor(self, *args: Any, **kwargs: Any) -> None:
        """Wait for the threads of the default executor while the clock stands still."""
        self._open_jobs += 1
        try:
            await super().shutdown_default_executor(*args, **kwargs)
        finally:
            self._open_jobs -= 1

    def _job_closed(self, _: asyncio.Future[Any]) -> None:
        self._open_jobs -= 1


class _JumpingSelector(selectors.BaseSelector):
    """A selector that moves its loop's clock instead of waiting."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        self._loop = loop
        self._real = selectors.DefaultSelector()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = self._real.select(0)
        if ready or timeout == 0:
            return ready
        if self._loop.has_open_jobs:
            return self._real.select(_EXECUTOR_TIMEOUT)
        if timeout is None:
            raise NothingWillEverHappen("everything waits and no timer is set")
        self._loop.advance(timeout)
        return []

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._real.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._real.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._real.modify(fileobj, events, data)

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._real.get_map()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._real.close()
