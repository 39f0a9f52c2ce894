"""Timers: call a callback at regular intervals."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from taskrpc.core.execution.callbacks import CallbackRunner


class Timer:
    """Calls its callback every `period` seconds; made by `Node.create_timer`.

    The intervals do not drift. Calls that are due while a call runs are skipped.
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
        """When the next call is due, on the loop's clock."""
        self._handle: asyncio.TimerHandle | None = None
        """The loop's timer for that call; None while the timer is stopped."""
        self._destroyed = False
        self.reset()

    @property
    def is_canceled(self) -> bool:
        """Whether the timer is stopped; `reset` starts it again."""
        return self._handle is None

    def cancel(self) -> None:
        """Stop the timer; a running callback is not stopped."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def reset(self) -> None:
        """Restart the timer: the next call is `period` seconds from now."""
        if not self._destroyed:
            self.cancel()
            self._due = self._loop.time() + self.period
            self._handle = self._loop.call_at(self._due, self._tick)

    def destroy(self) -> None:
        """Stop the timer for good.

        A callback that runs in the event loop is cancelled, unless it calls this itself.
        """
        self.cancel()
        self._destroyed = True
        self._runner.close()
        self._forget(self)

    def _count_into(self, topics: dict[str, Any]) -> None:
        """Do nothing: a timer has no topic."""

    def _tick(self) -> None:
        now = self._loop.time()
        missed = (now - self._due) // self.period if self.period else 0.0
        self._due = max(self._due + (missed + 1) * self.period, now)
        self._handle = self._loop.call_at(self._due, self._tick)
        if not self._runner.busy:
            self._runner.run()

    def _idle(self) -> None:
        """Do nothing when a callback ends: the next call is due at its own time."""
