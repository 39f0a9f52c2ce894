"""Why estimates change: each event is logged once, and each task selects the events that affect it.

When a task goes ahead of ten thousand queued tasks, all of them are delayed. The log stores that
as one event, with the place behind which it counts. What the event means for one task is computed
when a client shows that task.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice

import msgspec

from taskrpc.robot.tasks.model import EstimateChange, OrderKey

_KEPT_EVENTS = 4096
_ROUNDING_ERROR = 1e-6  # seconds; smaller delays are not logged


class DelayEvent(msgspec.Struct, frozen=True):
    """An event that delays tasks, or lets them end earlier."""

    number: int
    """The event's sequence number in the log."""
    after: OrderKey
    """The event counts for the tasks behind this place."""
    seconds: float
    """Robot seconds of delay; negative: the tasks end earlier."""
    cause: str
    """What happened, as users read it."""
    only_task: int = 0
    """If not 0: the id of the only task that the event counts for, wherever its place is."""


class DelayLog:
    """The newest events, in order."""

    def __init__(self) -> None:
        self._events: deque[DelayEvent] = deque(maxlen=_KEPT_EVENTS)
        self._next = 0  # the number of the next event
        self._may_merge = False  # whether the next delay may be added to the last event

    def add(self, after: OrderKey, seconds: float, cause: str, *, only_task: int = 0) -> None:
        """Log a delay; one that repeats the last event's place and cause is added to it."""
        if abs(seconds) < _ROUNDING_ERROR:
            return
        if self._may_merge:
            last = self._events[-1]
            if (last.after, last.cause, last.only_task) == (after, cause, only_task):
                total = last.seconds + seconds
                self._events[-1] = msgspec.structs.replace(last, seconds=total)
                return
        self._events.append(DelayEvent(self._next, after, seconds, cause, only_task))
        self._next += 1
        self._may_merge = True

    @property
    def next_number(self) -> int:
        """The number of the next event; unlike `mark`, the last event may still grow."""
        return self._next

    def mark(self) -> int:
        """Return the number of the next event; no earlier event changes after this."""
        self._may_merge = False
        return self._next

    def since(self, number: int) -> list[DelayEvent]:
        """Return the kept events from this number on, oldest first."""
        older = len(self._events) - (self._next - number)
        return list(islice(self._events, max(0, older), None))

    def is_complete_since(self, number: int) -> bool:
        """Return whether the log still has every event from this number on."""
        return number >= self._next - len(self._events)


class AcceptedEstimate:
    """The estimate that one task was accepted with, and the places that it has had since.

    Args:
        task_id: the task's id.
        seconds: the estimate, in robot seconds from `at` to the task's end.
        at: the instant of acceptance on the robot's clock.
        number: a mark of the log; the events from it on change the estimate.
        key: the task's place.
    """

    def __init__(self, task_id: int, seconds: float, at: float, number: int, key: OrderKey) -> None:
        self.task_id = task_id
        self.seconds = seconds
        self.at = at
        self._keys = [(number, key)]  # each holds from its mark of the log on

    @property
    def first_event(self) -> int:
        """The number of the first event that counts."""
        return self._keys[0][0]

    def move(self, number: int, key: OrderKey) -> None:
        """Note that the task has another place from this mark of the log on."""
        self._keys.append((number, key))

    def select(self, events: Sequence[DelayEvent]) -> list[DelayEvent]:
        """Return those of these consecutive events that change the task's estimate."""
        found: list[DelayEvent] = []
        first = events[0].number if events else 0
        ends = [number for number, _ in self._keys[1:]] + [first + len(events)]
        for (start, key), end in zip(self._keys, ends, strict=True):
            while_there = events[max(0, start - first) : max(0, end - first)]
            found += [event for event in while_there if self._is_affected(event, key)]
        return found

    def _is_affected(self, event: DelayEvent, key: OrderKey) -> bool:
        return event.only_task == self.task_id if event.only_task else event.after < key


def merged(changes: Iterator[EstimateChange], *, at_most: int) -> list[EstimateChange]:
    """Add up neighbours of equal cause, and the oldest changes beyond `at_most`."""
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
