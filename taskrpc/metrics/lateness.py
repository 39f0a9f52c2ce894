"""How late an event loop is: what holds it up keeps every call waiting."""

from __future__ import annotations

import asyncio

from taskrpc.metrics.families import Histogram

PERIOD = 0.5
"""Seconds between two looks."""


class Lateness:
    """Looks at a loop's clock from time to time, between `start` and `stop`."""

    def __init__(self) -> None:
        self.seconds = Histogram()
        """By how much each look came late."""
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Watch the running loop; a second start does nothing."""
        if self._timer is None:
            self._plan(asyncio.get_running_loop())

    def stop(self) -> None:
        """Watch no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _plan(self, loop: asyncio.AbstractEventLoop) -> None:
        due = loop.time() + PERIOD
        self._timer = loop.call_at(due, self._look, loop, due)

    def _look(self, loop: asyncio.AbstractEventLoop, due: float) -> None:
        self.seconds.observe(max(0.0, loop.time() - due))
        self._plan(loop)
