"""Statistics of a program's calls, which it sends to a program that watches it (`taskrpc top`).

Durations are counted in buckets. Each bound is 19 % above the one before it, so a percentile is
at most 10 % off.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping

import msgspec

from taskrpc.core.wire.messages import Name, decoder

BOUNDS = tuple(1e-6 * 2 ** (number / 4) for number in range(160))
"""The upper bounds of the buckets in seconds: from 1 µs to 9 days."""


class ServiceStatistics(msgspec.Struct, array_like=True):
    """The calls of one service."""

    name: Name
    running: int
    """Calls whose callback runs now."""
    waiting: int
    """Calls that wait in the service's queue now."""
    codes: dict[int, int] = {}
    """How many calls have ended, by status code."""
    durations: dict[int, int] = {}
    """How many calls have ended, by bucket of their duration from arrival to response."""


class Statistics(msgspec.Struct, array_like=True):
    """The calls of one program's services since it was first watched."""

    clock: float
    """When this was measured: seconds on a clock of the program."""
    since: float
    """When the counts began, on the same clock. New counts begin after a time without watchers."""
    cpu: float
    """Seconds of CPU time that the program has used."""
    connections: int
    """Open connections from other programs, without those that watch."""
    services: list[ServiceStatistics] = []
    callers: dict[Name, int] = {}
    """How many calls have ended, by the node that made them."""


decode_statistics = decoder(Statistics)
"""Raises ProtocolError for an invalid body, and no other error."""


def bucket_of(seconds: float) -> int:
    """Return the bucket of a duration: the first one whose bound is not below it."""
    return bisect_left(BOUNDS, seconds, hi=len(BOUNDS) - 1)


def percentile(durations: Mapping[int, int], fraction: float) -> float | None:
    """Return the seconds below which this fraction of the calls stayed; None without calls."""
    rank = fraction * sum(durations.values())
    below = 0
    for bucket in sorted(durations):
        count = durations[bucket]
        if count and below + count >= rank:
            upper = BOUNDS[max(0, min(bucket, len(BOUNDS) - 1))]
            # Between the bounds of the bucket, as if its calls were spread evenly.
            return upper * 2 ** (((rank - below) / count - 1) / 4)
        below += count
    return None
