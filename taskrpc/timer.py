"""Timers: a callback at even intervals."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from taskrpc.execution.callbacks import CallbackRunner


class Timer:
    """Calls its callback every `period` seconds; made by `Node.create_timer`.

    The intervals do not drift. While a call runs, those that were due are left out.
    """

    def __init__(
        self,
        period: float,
        callback: Callable[[], object],
        *,
        threaded: bool = False,
        forget: Callable[[Timer], object] = lambda _: None,
    ) -> None:
        if not (isinstance(period, int | float) and 0 <= period < math.inf):
            raise ValueError(f"period: expected seconds, at least 0, got {period!r}")
        self.period = period
        """Seconds."""
        self._loop = asyncio.get_running_loop()
        name = getattr(callback, "__qualname__", "a callback")
        self._runner = CallbackRunner(
            callback, f"the timer of {name}", threaded=threaded, idle=self._idle
        )
        self._forget = forget
        self._due = 0.0
        self._handle: asyncio.TimerHandle | None = None
        self._destroyed = False
        self.reset()

    @property
    def is_canceled(self) -> bool:
        """Whether it stands still; `reset` starts it again."""
        return self._handle is None

    def cancel(self) -> None:
        """Stand still; a call that runs is not stopped."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def reset(self) -> None:
        """Start again: the next call is `period` seconds from now."""
        if not self._destroyed:
            self.cancel()
            self._due = self._loop.time() + self.period
            self._handle = self._loop.call_at(self._due, self._tick)

    def destroy(self) -> None:
        """Stop for ever.

        A call that runs in the event loop is cancelled, unless it is the one that says so.
        """
        self.cancel()
        self._destroyed = True
        self._runner.close()
        self._forget(self)

    def _count_into(self, topics: dict[str, Any]) -> None:
        """A timer has no part in topics."""

    def _tick(self) -> None:
        now = self._loop.time()
        missed = (now - self._due) // self.period if self.period else 0.0
        self._due = max(self._due + (missed + 1) * self.period, now)
        self._handle = self._loop.call_at(self._due, self._tick)
        if not self._runner.busy:
            self._runner.run()

    def _idle(self) -> None:
        """A call that took a while has ended: the next one is due when it is due."""
