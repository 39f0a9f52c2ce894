"""The deadlines of open calls: never checked early, at most half a tick late.

A timer for each call would cost a third of the call; an entry in a timer wheel would cost a
twentieth. Here a new call compares two numbers, and an answered call does nothing. Each connection
has one timer: it checks the open calls when the earliest deadline has passed.
"""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Callable, Iterable
from contextvars import Context, copy_context
from typing import Protocol

from taskrpc.core.callinfo import answering

TICK = 0.005
"""Seconds by which an expired call may end late."""

CHECK_LATE = TICK / 2
"""Seconds by which a check may be late. In the rest of the tick the server may answer whether an
expired call had begun."""

_RESOLUTION = 1e-9
"""Seconds by which an event loop may call a timer early, by its own clock."""
_COST = 1e-6
"""Seconds of pause for each call that a check examined: thousands must not fill a whole tick."""


class CheckPlan:
    """Decides when to check for expired calls: plain arithmetic, with the time as an argument."""

    __slots__ = ("at", "threshold")

    def __init__(self) -> None:
        self.at = math.inf
        """The instant of the next check; infinite if none is planned."""
        self.threshold = math.inf
        """A new deadline below this needs an earlier check; others are checked in time."""

    def expect(self, deadline: float) -> None:
        """Plan a check at a deadline."""
        self.at = deadline
        self.threshold = deadline - CHECK_LATE

    def checked(self, now: float, earliest: float, calls: int) -> None:
        """Plan the check that follows one of so many calls; `earliest` is the next deadline."""
        if earliest == math.inf:
            self.at = self.threshold = math.inf
        else:
            self.expect(max(earliest, now + max(CHECK_LATE, calls * _COST)))


def is_over(deadline: float, now: float) -> bool:
    """Whether a deadline has passed."""
    return deadline <= now + _RESOLUTION


def clock_of(loop: asyncio.AbstractEventLoop) -> Callable[[], float]:
    """The clock behind `loop.time`, read directly where it is `time.monotonic`.

    asyncio's wrapper takes twice as long. uvloop's own reading stands still while callbacks
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

    check_before: float
    """An earlier deadline must be passed to `watch`; infinite while there is none."""

    def expiring(self) -> Iterable[Expiring]:
        """The open calls."""


class Deadlines:
    """Calls `expired()` on a holder's open calls whose deadline has passed, with one timer."""

    __slots__ = ("_context", "_holder", "_loop", "_plan", "_timer")

    def __init__(self, loop: asyncio.AbstractEventLoop, holder: Holder) -> None:
        self._loop = loop
        self._holder = holder
        self._plan = CheckPlan()
        self._timer: asyncio.TimerHandle | None = None
        self._context: Context | None = None
        """The context of the timer, without a call: a callback's own would keep its call alive."""

    def watch(self, deadline: float) -> None:
        """Check the open calls when this deadline passes."""
        # Other threads may pass several deadlines before the event loop handles the first.
        if deadline < self._holder.check_before:
            self._plan.expect(deadline)
            self._arm()

    def close(self) -> None:
        """Stop the timer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _arm(self) -> None:
        self.close()
        self._holder.check_before = self._plan.threshold
        if self._plan.at != math.inf:
            if self._context is None:
                self._context = copy_context()
                self._context.run(answering.set, None)
            self._timer = self._loop.call_at(self._plan.at, self._check, context=self._context)

    def _check(self) -> None:
        self._timer = None
        # A call that a thread begins from here on is not among those checked below.
        self._holder.check_before = math.inf
        now = self._loop.time()
        open_calls = self._holder.expiring()
        calls = [(call.deadline, call) for call in open_calls if call.deadline is not None]
        left = [deadline for deadline, _ in calls if not is_over(deadline, now)]
        self._plan.checked(now, min(left, default=math.inf), len(calls))
        self._arm()
        for deadline, call in calls:
            if is_over(deadline, now):
                call.expired()
