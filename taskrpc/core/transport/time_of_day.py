"""The time of day: the machine's, or that of an event loop in a test.

What the library stores, sends or compares as a time of day comes from here, so that a run in
virtual time can be repeated. A loop with the method `time_of_day` gives it to everything that runs
on it. Only `taskrpc.testing.VirtualTimeLoop` with a seed has one.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable


def time_of_day() -> float:
    """Return the seconds since 1970."""
    own = _of_the_loop()
    return time.time() if own is None else own()


def time_of_day_ns() -> int:
    """Return the nanoseconds since 1970."""
    own = _of_the_loop()
    return time.time_ns() if own is None else round(own() * 10**9)


def _of_the_loop() -> Callable[[], float] | None:
    """Return the method of the running event loop, None if it has none."""
    try:
        return getattr(asyncio.get_running_loop(), "time_of_day", None)
    except RuntimeError:
        return None
