"""The lookout for deadlines on an event loop: one timer for all calls of a connection."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Callable, Iterable
from typing import Protocol

from taskrpc.deadline import Lookout, is_over


def clock_of(loop: asyncio.AbstractEventLoop) -> Callable[[], float]:
    """The clock behind `loop.time`, read directly where it is `time.monotonic`.

    asyncio's wrapper costs twice the reading. uvloop's own reading stands still while callbacks
    run, so that deadlines counted from it would come early; on Linux it has the same origin.
    """
    own = type(loop).time is asyncio.BaseEventLoop.time
    same = own or (sys.platform == "linux" and type(loop).__module__.startswith("uvloop"))
    return time.monotonic if same else loop.time


class Expiring(Protocol):
    """A call that may have a deadline."""

    deadline: float | None

    def expired(self) -> None:
        """The deadline has passed."""


class Holder(Protocol):
    """Whoever has open calls."""

    look_before: float
    """Deadlines below must be told to `watch`; infinite while there is none."""

    def expiring(self) -> Iterable[Expiring]:
        """The open calls."""


class Deadlines:
    """Calls `expired()` on a holder's open calls whose deadline has passed, with one timer."""

    __slots__ = ("_holder", "_lookout", "_loop", "_timer")

    def __init__(self, loop: asyncio.AbstractEventLoop, holder: Holder) -> None:
        self._loop = loop
        self._holder = holder
        self._lookout = Lookout()
        self._timer: asyncio.TimerHandle | None = None

    def watch(self, deadline: float) -> None:
        """Look at the open calls when this deadline passes."""
        # Other threads than the loop's tell of several before the first is heard.
        if deadline < self._holder.look_before:
            self._lookout.expect(deadline)
            self._arm()

    def close(self) -> None:
        """Stop the timer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _arm(self) -> None:
        self.close()
        self._holder.look_before = self._lookout.threshold
        if self._lookout.at != math.inf:
            self._timer = self._loop.call_at(self._lookout.at, self._look)

    def _look(self) -> None:
        self._timer = None
        # A thread that calls from here on is not among those that are looked through.
        self._holder.look_before = math.inf
        now = self._loop.time()
        open_calls = self._holder.expiring()
        calls = [(call.deadline, call) for call in open_calls if call.deadline is not None]
        left = [deadline for deadline, _ in calls if not is_over(deadline, now)]
        self._lookout.looked(now, min(left, default=math.inf), len(calls))
        self._arm()
        for deadline, call in calls:
            if is_over(deadline, now):
                call.expired()
