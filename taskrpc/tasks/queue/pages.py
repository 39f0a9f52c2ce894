"""Long lists in pages: what runs, what waits, what has ended.

A page ends with a cursor that names a place in the order, not a count, so that it stays right
while the queue moves on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

from taskrpc.tasks.manager import TaskManager
from taskrpc.tasks.model import Key, Task
from taskrpc.tasks.queue.schedule import RUNNING_KEY

PAGE = 200
"""Tasks on a page, if nobody asks for fewer."""

_WAITING = re.compile(r"w(-\d{1,3}):(\d{1,18})", re.ASCII)
_ENDED = re.compile(r"e([\d.e+-]{1,32}):(\d{1,18})", re.ASCII)
_BEFORE_ALL: Key = (RUNNING_KEY[0] - 1, 0)


class Row(NamedTuple):
    """A task in a list."""

    task: Task
    estimated_time: float
    """Robot seconds until it is done."""
    cursor: str
    """Ask for what comes after this row with it."""


class Page(NamedTuple):
    """A part of a list."""

    rows: list[Row]
    next_page: str
    """The cursor of the next page, empty after the last."""


def page(manager: TaskManager, cursor: str, *, limit: int = PAGE, ended: bool = False) -> Page:
    """Return the page behind a cursor (empty: the first one), `ended` tasks last if wanted.

    Raises:
        ValueError: no page ended with this cursor.
    """
    manager.reckon()
    limit = min(limit or PAGE, PAGE)
    rows = list(islice(_rows(manager, cursor, ended), limit + 1))
    return Page(rows[:limit], rows[limit - 1].cursor if len(rows) > limit else "")


def _rows(manager: TaskManager, cursor: str, ended: bool) -> Iterator[Row]:
    after, before = _place(cursor)
    if before is None:
        yield from _waiting_rows(manager, after)
    if ended:
        yield from _ended_rows(manager, before)


def _place(cursor: str) -> tuple[Key, tuple[float, int] | None]:
    """Where a page begins: behind a key of the queue, or before an end."""
    if not cursor:
        return _BEFORE_ALL, None
    if match := _WAITING.fullmatch(cursor):
        return (int(match[1]), int(match[2])), None
    if match := _ENDED.fullmatch(cursor):
        return RUNNING_KEY, (float(match[1]), int(match[2]))
    raise ValueError(f"page: expected `next_page` of an earlier answer, got {cursor[:40]!r}")


def _waiting_rows(manager: TaskManager, after: Key) -> Iterator[Row]:
    if after < RUNNING_KEY and (running := manager.running):
        yield Row(running, manager.estimate(running.task_id), _waiting_cursor(RUNNING_KEY))
    ahead = manager.seconds_ahead()
    for waiting, seconds in manager.queue.ordered(max(after, RUNNING_KEY)):
        if task := manager.book.find(waiting.task_id):  # else it is not stored yet
            yield Row(task, ahead + seconds, _waiting_cursor(waiting.key))


def _ended_rows(manager: TaskManager, before: tuple[float, int] | None) -> Iterator[Row]:
    ends = ((task.ended_at or 0.0, task.task_id, task) for task in manager.book.ended())
    for ended_at, task_id, task in sorted(ends, key=lambda end: end[:2], reverse=True):
        if before is None or (ended_at, task_id) < before:
            yield Row(task, 0.0, f"e{ended_at!r}:{task_id}")


def _waiting_cursor(key: Key) -> str:
    return f"w{key[0]}:{key[1]}"
