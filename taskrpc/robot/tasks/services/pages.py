"""Task lists in pages: the running tasks, the queue, the ended tasks.

A page ends with a cursor. The cursor names a place in the order instead of a count, so it stays
correct while tasks come and go.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

from taskrpc.robot.tasks.managed import ManagedTasks
from taskrpc.robot.tasks.model import BEFORE_RUNNING_KEY, RUNNING_KEY, OrderKey, Task

PAGE = 200
"""The most tasks on a page."""

_QUEUE_CURSOR = re.compile(r"w(-\d{1,3}):(\d{1,18})", re.ASCII)
_ENDED_CURSOR = re.compile(r"e([\d.e+-]{1,32}):(\d{1,18})", re.ASCII)


class Row(NamedTuple):
    """A task in a list."""

    task: Task
    estimated_time: float
    """Robot seconds from now to its end."""
    cursor: str
    """The cursor of the list behind this row."""


class Page(NamedTuple):
    """A part of a list."""

    rows: list[Row]
    next_page: str
    """The cursor of the next page; "" on the last page."""


def page(manager: ManagedTasks, cursor: str, *, limit: int = PAGE, ended: bool = False) -> Page:
    """Return the page behind a cursor ("": the first page); with `ended`, ended tasks come last.

    Raises:
        ValueError: the cursor is not one of a page.
    """
    manager.update_estimates()
    limit = min(limit or PAGE, PAGE)
    rows = list(islice(_rows(manager, cursor, ended), limit + 1))
    return Page(rows[:limit], rows[limit - 1].cursor if len(rows) > limit else "")


def _rows(manager: ManagedTasks, cursor: str, ended: bool) -> Iterator[Row]:
    after, before = _start_of(cursor)
    if before is None:
        yield from _live_rows(manager, after)
    if ended:
        yield from _ended_rows(manager, before)


def _start_of(cursor: str) -> tuple[OrderKey, tuple[float, int] | None]:
    """Return where a page begins: the key in the queue, or the (end, id) of an ended task."""
    if not cursor:
        return BEFORE_RUNNING_KEY, None
    if match := _QUEUE_CURSOR.fullmatch(cursor):
        return (int(match[1]), int(match[2])), None
    if match := _ENDED_CURSOR.fullmatch(cursor):
        return RUNNING_KEY, (float(match[1]), int(match[2]))
    raise ValueError(f"page: expected `next_page` of an earlier response, got {cursor[:40]!r}")


def _live_rows(manager: ManagedTasks, after: OrderKey) -> Iterator[Row]:
    for key, task in manager.begun():
        if after < key:
            yield Row(task, manager.estimate(task.task_id), _queue_cursor(key))
    for key, task, seconds in manager.waiting(after):
        yield Row(task, seconds, _queue_cursor(key))


def _ended_rows(manager: ManagedTasks, before: tuple[float, int] | None) -> Iterator[Row]:
    ends = ((task.ended_at or 0.0, task.task_id, task) for task in manager.repository.ended())
    for ended_at, task_id, task in sorted(ends, key=lambda end: end[:2], reverse=True):
        if before is None or (ended_at, task_id) < before:
            yield Row(task, 0.0, f"e{ended_at!r}:{task_id}")


def _queue_cursor(key: OrderKey) -> str:
    return f"w{key[0]}:{key[1]}"
