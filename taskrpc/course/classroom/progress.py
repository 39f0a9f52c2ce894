"""How far each student of a class is: not here, just begun, stuck, or working. Pure."""

from __future__ import annotations

from enum import StrEnum

import msgspec

STUCK_AFTER = 120.0
"""Seconds after which a student without a successful call counts as stuck."""
GONE_AFTER = 900.0
"""Seconds without a connection or a call after which a student counts as away."""


class Progress(StrEnum):
    """How far a student is."""

    AWAY = "away"
    """Neither connected nor calling."""
    NEW = "new"
    """Here for a short time, and without a successful call."""
    STUCK = "stuck"
    """Here for a long time, and still without a successful call."""
    WORKING = "working"
    """Has made a successful call."""


class Signs(msgspec.Struct):
    """What a server knows of a student since it started, or since the group began."""

    connected: bool = False
    begun: float | None = None
    """When the student was first connected or called, in seconds since 1970."""
    last: float | None = None
    """When the student last called."""
    succeeded: int = 0
    """Successful calls."""


def progress(signs: Signs, now: float) -> Progress:
    """Return how far a student is; `now` is in seconds since 1970."""
    last = now if signs.connected else signs.last
    if signs.begun is None or last is None or now - last >= GONE_AFTER:
        return Progress.AWAY
    if signs.succeeded:
        return Progress.WORKING
    return Progress.STUCK if now - signs.begun >= STUCK_AFTER else Progress.NEW
