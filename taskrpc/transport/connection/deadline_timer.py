"""The deadlines of open calls: never checked early, at most half a tick late.

A timer for each call costs a third of the call, an entry in a timer wheel a twentieth. Here a new
call compares two numbers, and an answered call does nothing: one timer for each connection looks
through its open calls when the earliest deadline has passed.
"""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Callable, Iterable
from typing import Protocol

TICK = 0.005
"""Seconds by which a call may be told late that its deadline has passed."""

LOOK_LATE = TICK / 2
"""Seconds by which a check may be late. In the rest of the tick the server may answer whether an
expired call had begun."""

_RESOLUTION = 1e-9
"""Seconds by which the clock of an event loop may be before a timer's instant when it fires."""
_COST = 1e-6
"""Seconds of pause for each call that a look examined: thousands of them must not fill a tick."""


class Lookout:
    """Decides when to look for expired calls: plain arithmetic, with the time as an argument."""

    __slots__ = ("at", "threshold")

    def __init__(self) -> None:
        self.at = math.inf
        """The instant of the next look; infinite if none is planned."""
        self.threshold = math.inf
        """A new deadline below this needs an earlier look; later ones are seen in time anyway."""

    def expect(self, deadline: float) -> None:
        """Plan a look at a deadline."""
        self.at = deadline
        self.threshold = deadline - LOOK_LATE

    def looked(self, now: float, earliest: float, calls: int) -> None:
        """Plan the next look after a look at so many calls; `earliest` is the next deadline."""
        if earliest == math.inf:
            self.at = self.threshold = math.inf
        else:
            self.expect(max(earliest, now + max(LOOK_LATE, calls * _COST)))


def is_over(deadline: float, now: float) -> bool:
    """Whether a deadline has passed."""
    return deadline <= now + _RESOLUTION


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
    """An owner of open calls."""

    look_before: float
    """An earlier deadline must be passed to `watch`; infinite while there is none."""

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
        # Other threads may pass several deadlines before the event loop handles the first.
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
        # A call that a thread begins from here on is not among those checked below.
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
