"""The history of one frame: its transforms to its parent, in order of time.

Times are nanoseconds. Time 0 means the latest, as in all of tf2.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from operator import attrgetter
from typing import NamedTuple, Protocol

from .exceptions import ExtrapolationException
from .geometry import Transform

LATEST = 0
"""The time that asks for the latest transform."""

_by_time = attrgetter("time")


def shown(time: int) -> str:
    """A time in seconds, as in tf2's errors."""
    return f"{time / 1e9:.6f}"


class Entry(NamedTuple):
    """A transform from a frame to its parent, at a time."""

    time: int
    parent: str
    transform: Transform


class FrameCache(Protocol):
    """The history of one frame."""

    def insert(self, entry: Entry) -> bool:
        """Keep a transform; False if it is too old to keep."""

    def at(self, time: int) -> Entry:
        """The transform at a time. Raises ExtrapolationException."""

    def newest(self) -> Entry | None:
        """The transform with the latest time; None while there is none."""

    @property
    def latest_time(self) -> int:
        """The time of the newest transform; 0 for static transforms, and while there is none."""

    @property
    def oldest_time(self) -> int:
        """The time of the oldest transform, likewise."""

    def __len__(self) -> int:
        """The number of transforms."""

    def clear(self) -> None:
        """Forget the transforms, unless they are static."""


class TimeCache:
    """The transforms of a frame that moves, for the last `duration` nanoseconds."""

    def __init__(self, duration: int) -> None:
        self._duration = duration
        self._entries: list[Entry] = []
        """Oldest first."""

    def insert(self, entry: Entry) -> bool:
        """Keep a transform, in any order of arrival; False if it is too old to keep."""
        entries = self._entries
        if entries:
            oldest_kept = self.latest_time - self._duration
            del entries[: bisect_left(entries, oldest_kept, key=_by_time)]
            if entry.time < oldest_kept:
                return False
        end = bisect_right(entries, entry.time, key=_by_time)
        if entry not in entries[bisect_left(entries, entry.time, key=_by_time) : end]:
            entries.insert(end, entry)
        return True

    def at(self, time: int) -> Entry:
        """The transform at a time, interpolated between its neighbours.

        Between two neighbours with different parents it is the older one.

        Raises:
            ExtrapolationException: the time is outside the history.
        """
        entries = self._entries
        if not entries:
            raise ExtrapolationException("")
        if time == LATEST:
            return entries[-1]
        end = bisect_right(entries, time, key=_by_time)
        if end and entries[end - 1].time == time:
            return entries[end - 1]
        if not 0 < end < len(entries):
            raise ExtrapolationException(self._outside(time))
        older, newer = entries[end - 1], entries[end]
        if older.parent != newer.parent:
            return older
        ratio = (time - older.time) / (newer.time - older.time)
        return Entry(time, older.parent, older.transform.toward(newer.transform, ratio))

    def newest(self) -> Entry | None:
        """The transform with the latest time; None while there is none."""
        return self._entries[-1] if self._entries else None

    @property
    def latest_time(self) -> int:
        """The time of the newest transform; 0 while there is none."""
        return self._entries[-1].time if self._entries else 0

    @property
    def oldest_time(self) -> int:
        """The time of the oldest transform; 0 while there is none."""
        return self._entries[0].time if self._entries else 0

    def __len__(self) -> int:
        return len(self._entries)

    def clear(self) -> None:
        """Forget all transforms."""
        self._entries.clear()

    def _outside(self, time: int) -> str:
        if len(self) == 1:
            return (
                f"Lookup would require extrapolation at time {shown(time)},"
                f" but only time {shown(self.latest_time)} is in the buffer"
            )
        if time > self.latest_time:
            return (
                f"Lookup would require extrapolation into the future.  Requested time"
                f" {shown(time)} but the latest data is at time {shown(self.latest_time)}"
            )
        return (
            f"Lookup would require extrapolation into the past.  Requested time {shown(time)}"
            f" but the earliest data is at time {shown(self.oldest_time)}"
        )


class StaticCache:
    """The one transform of a frame that does not move: it holds at all times."""

    latest_time = 0
    oldest_time = 0

    def __init__(self) -> None:
        self._entry: Entry | None = None

    def insert(self, entry: Entry) -> bool:
        """Replace the transform."""
        self._entry = entry._replace(time=0)
        return True

    def at(self, time: int) -> Entry:
        """The transform."""
        if self._entry is None:
            raise ExtrapolationException("")
        return self._entry._replace(time=time)

    def newest(self) -> Entry | None:
        """The transform, with time 0."""
        return self._entry

    def __len__(self) -> int:
        return 1

    def clear(self) -> None:
        """Do nothing: a static transform is sent only once."""
