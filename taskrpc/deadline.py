"""When to check for calls whose deadline has passed: never early, at most half a tick late.

A timer a call costs a third of the call, an entry in a timer wheel a twentieth. Here a new call
compares two numbers, and an answered one does nothing: who holds the open calls looks through
them when the earliest deadline that was ever told is due.
"""

from __future__ import annotations

import math

TICK = 0.005
"""Seconds by which a call may learn late that its time is over."""

LOOK_LATE = TICK / 2
"""Seconds by which a check may be late. In the rest of the tick the server may answer whether an
expired call had begun."""

_RESOLUTION = 1e-9  # an event loop's clock may stand so far before the instant that it woke for
_COST = 1e-6
"""Seconds of rest for each call that was looked through: thousands of them must not fill a tick."""


class Lookout:
    """Says when to look again; the caller brings the clock, the timer and the calls."""

    __slots__ = ("at", "threshold")

    def __init__(self) -> None:
        self.at = math.inf
        """The instant of the next look; none is planned while it is infinite."""
        self.threshold = math.inf
        """Deadlines below must be told; those from here on are looked at in time anyway."""

    def expect(self, deadline: float) -> None:
        """Plan a look at a deadline."""
        self.at = deadline
        self.threshold = deadline - LOOK_LATE

    def looked(self, now: float, earliest: float, calls: int) -> None:
        """After a look at so many calls; `earliest` is the first deadline of what is left."""
        if earliest == math.inf:
            self.at = self.threshold = math.inf
        else:
            self.expect(max(earliest, now + max(LOOK_LATE, calls * _COST)))


def is_over(deadline: float, now: float) -> bool:
    """Whether a deadline has passed."""
    return deadline <= now + _RESOLUTION
