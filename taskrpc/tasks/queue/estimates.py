"""Why estimates move: every event is written down once, and each task picks out its own.

Ten thousand waiting tasks are all delayed when one goes ahead of them. That is one entry here, with
the place behind which it counts; what it means for one task is worked out when somebody asks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice

import msgspec

from taskrpc.tasks.model import EstimateChange, Key

_NOISE = 1e-6  # seconds; below it is rounding


class Event(msgspec.Struct, frozen=True):
    """Something that made tasks later or earlier."""

    number: int
    """Counts the events."""
    after: Key
    """It counts for the tasks that stand behind this place."""
    seconds: float
    cause: str
    only: int = 0
    """If not 0: the number of the one task for which it counts, wherever that stands."""


class EventLog:
    """The newest events, in order.

    Args:
        capacity: how many are remembered.
    """

    def __init__(self, capacity: int = 4096) -> None:
        self._events: deque[Event] = deque(maxlen=capacity)
        self._next = 0
        self._may_merge = False

    def add(self, after: Key, seconds: float, cause: str, *, only: int = 0) -> None:
        """Write an event down; more of the same makes the last one larger."""
        if abs(seconds) < _NOISE:
            return
        if self._may_merge:
            last = self._events[-1]
            if (last.after, last.cause, last.only) == (after, cause, only):
                total = last.seconds + seconds
                self._events[-1] = msgspec.structs.replace(last, seconds=total)
                return
        self._events.append(Event(self._next, after, seconds, cause, only))
        self._next += 1
        self._may_merge = True

    def mark(self) -> int:
        """Return the number that the next event will have; none before it will grow any more."""
        self._may_merge = False
        return self._next

    def since(self, number: int) -> list[Event]:
        """Return the remembered events from a mark on, oldest first."""
        older = len(self._events) - (self._next - number)
        return list(islice(self._events, max(0, older), None))

    def remembers(self, number: int) -> bool:
        """Whether no event since this mark has been forgotten."""
        return number >= self._next - len(self._events)


class Promise:
    """What one task was told when it was accepted, and where it has stood since.

    Args:
        task_id: the task's number.
        seconds: the estimate that was given.
        at: the instant of acceptance on the robot's clock.
        number: a mark of the log: what happens from here on changes the estimate.
        key: the task's place.
    """

    def __init__(self, task_id: int, seconds: float, at: float, number: int, key: Key) -> None:
        self.task_id = task_id
        self.seconds = seconds
        self.at = at
        self._places = [(number, key)]

    @property
    def number(self) -> int:
        """The mark from which on events count."""
        return self._places[0][0]

    def move(self, number: int, key: Key) -> None:
        """From a mark of the log on, the task stands at another place."""
        self._places.append((number, key))

    def among(self, events: Sequence[Event]) -> list[Event]:
        """Those of these consecutive events since the acceptance that change its estimate."""
        found: list[Event] = []
        first = events[0].number if events else 0
        ends = [number for number, _ in self._places[1:]] + [first + len(events)]
        for (start, place), end in zip(self._places, ends, strict=True):
            while_there = events[max(0, start - first) : max(0, end - first)]
            found += [event for event in while_there if self._concerns(event, place)]
        return found

    def _concerns(self, event: Event, place: Key) -> bool:
        return event.only == self.task_id if event.only else event.after < place


def joined(changes: Iterator[EstimateChange], *, at_most: int) -> list[EstimateChange]:
    """Add up neighbours of one cause, and the oldest ones where they are too many to list."""
    rows: list[EstimateChange] = []
    for change in changes:
        if rows and rows[-1].cause == change.cause:
            rows[-1] = EstimateChange(rows[-1].seconds + change.seconds, change.cause)
        else:
            rows.append(change)
    surplus = len(rows) - at_most
    if surplus <= 0:
        return rows
    total = sum(change.seconds for change in rows[: surplus + 1])
    return [EstimateChange(total, f"{surplus + 1} earlier changes"), *rows[surplus + 1 :]]
