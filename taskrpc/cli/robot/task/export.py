"""`taskrpc task export`: the ended tasks of a database as CSV or as lines of JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from taskrpc.cli.shared.task_database import default_database, is_shared
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.records.archive import SqliteEndedTasks, pages_of

if TYPE_CHECKING:
    from taskrpc.robot.tasks.records.archive import EndedTasks

COLUMNS = (
    "task_id",
    "task_type",
    "target",
    "priority",
    "state",
    "submitted_by",
    "submitted_from",
    "robot",
    "submitted",
    "started",
    "ended",
    "ended_by",
    "reason",
    "decisions",
)
"""The columns of the CSV file, and the keys of each line of JSON. New ones come at the end."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_LATEST = 253_402_300_799.0  # the last second of the year 9999
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a spreadsheet takes for the beginning of a formula."""


async def export(
    database: str | None, since: float, *, as_csv: bool, write: Callable[[str], object]
) -> None:
    """Write all tasks that ended at an instant or later, a page at a time.

    Raises TaskRpcError if the database cannot be read.
    """
    source = _source(database)
    try:
        if as_csv:
            write(_csv([COLUMNS]))
        async for tasks in pages_of(source, since):
            write(_csv(map(_cells, tasks)) if as_csv else "".join(map(_line, tasks)))
    finally:
        await source.close()


def _source(database: str | None) -> EndedTasks:
    if database is None or not is_shared(database):
        return SqliteEndedTasks(Path(database) if database else default_database())
    from taskrpc.robot.fleet.postgres.archive import PostgresEndedTasks

    return PostgresEndedTasks(database)


def _values(task: Task) -> dict[str, object]:
    """Return the values of `COLUMNS` without `decisions`."""
    is_decided = task.state is TaskState.CANCELED and task.decisions
    return {
        "task_id": task.task_id,
        "task_type": task.task_type,
        "target": task.target,
        "priority": task.priority,
        "state": task.state.value,
        "submitted_by": task.client,
        "submitted_from": task.machine,
        "robot": task.robot,
        "submitted": _instant(task.submitted_at),
        "started": _instant(task.started_at),
        "ended": _instant(task.ended_at),
        "ended_by": task.decisions[-1].client if is_decided else "",
        "reason": task.message,
    }


def _line(task: Task) -> str:
    decisions = [
        {"at": _instant(each.at), "by": each.client, "action": each.action}
        for each in task.decisions
    ]
    return json.dumps(_values(task) | {"decisions": decisions}) + "\n"


def _cells(task: Task) -> list[object]:
    decisions = (f"{_instant(each.at)} {each.client}: {each.action}" for each in task.decisions)
    return [_harmless(each) for each in (*_values(task).values(), "; ".join(decisions))]


def _csv(rows: Iterable[Iterable[object]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _harmless(value: object) -> object:
    """Return a cell that no spreadsheet takes for a formula: a client chose some of the texts."""
    if isinstance(value, str) and value.startswith(_FORMULA):
        return f"'{value}"
    return value


def _instant(seconds: float | None) -> str | None:
    """Return an instant as ISO 8601 in UTC."""
    if seconds is None:
        return None
    # A wall clock may have been wrong by centuries.
    at = _EPOCH + timedelta(seconds=min(max(seconds, 0.0), _LATEST))
    return at.isoformat(timespec="milliseconds").removesuffix("+00:00") + "Z"
