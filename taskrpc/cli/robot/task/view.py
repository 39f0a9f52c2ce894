"""Tasks as text and as JSON values, as `taskrpc task` prints them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from srvgen.stubs.builtin_interfaces.msg import Time
    from srvgen.stubs.taskrpc_interfaces.msg import EstimateChange, TaskInfo

from taskrpc.observe.texts import printable, work_of

_NOTEWORTHY = 0.05  # seconds of a change; less would be shown as 0.0
_LONG = 8  # longest list whose values are all shown; of others only the range


def table(tasks: Sequence[TaskInfo]) -> list[str]:
    """Return tasks as aligned lines under a heading; no lines if there are no tasks."""
    rows = [
        [str(t.task_id), work_of(t), str(t.priority), t.state, _outlook(t), printable(t.client)]
        for t in tasks
    ]
    if not rows:
        return []
    heading = ["task", "what", "priority", "state", "done in", "client"]
    if any(task.robot for task in tasks):  # a fleet
        heading.insert(4, "robot")
        for row, task in zip(rows, tasks, strict=True):
            row.insert(4, _robot(task))
    return aligned([heading, *rows], right={0, 2})


def aligned(rows: Sequence[Sequence[str]], *, right: Iterable[int] = ()) -> list[str]:
    """Return rows as lines with aligned columns; the columns in `right` are right-aligned."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    cells = (
        (cell.rjust(width) if i in right else cell.ljust(width))
        for row in rows
        for i, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return ["  ".join(next(cells) for _ in widths).rstrip() for _ in rows]


def status_line(task: TaskInfo) -> str:
    """Return a task's current state in one line."""
    words = [f"task {task.task_id}", work_of(task), f"priority {task.priority}", task.state]
    message = printable(task.message)
    if (outlook := _outlook(task)) and outlook != message:
        words.append(f"done in {outlook}")
    if message:
        words.append(message)
    return "  ".join(words)


def details(task: TaskInfo) -> list[str]:
    """Return everything about a task; each change of its estimate is a line."""
    lines = [f"task {task.task_id}: {work_of(task)}, priority {task.priority}"]
    message = printable(task.message)
    facts = [
        ("state", f"{task.state}, {_percent(task)} done" if _is_begun(task) else task.state),
        ("robot", _robot(task)),
        ("message", message),
        ("client", printable(task.client)),
        ("submitted", _clock(task.submitted)),
        ("started", _clock(task.started)),
        ("ended", _clock(task.ended)),
        ("done in", "" if _outlook(task) in ("", message) else in_seconds(task.estimated_time)),
        ("promised", f"{task.accepted_estimate:.1f} s"),
    ]
    lines += [f"  {name + ':':<10} {fact}" for name, fact in facts if fact]
    changes = (each for each in task.estimate_changes if abs(each.seconds) >= _NOTEWORTHY)
    lines += [f"    {change(each)}" for each in changes]
    for name, value in (result(task) or {}).items():
        lines.append(f"  {printable(name) + ':':<10} {_brief(value)}")
    return lines


def change(estimate_change: EstimateChange) -> str:
    """Return why a task ends later or earlier: `+12.4 s: task 17, priority 10, went ahead`."""
    return f"{estimate_change.seconds:+.1f} s: {printable(estimate_change.cause)}"


def result(task: TaskInfo) -> Any:
    """Return a task's result as JSON values; None if it has none (yet)."""
    return json.loads(task.result) if task.result else None


def as_object(task: TaskInfo) -> dict[str, object]:
    """Return a task as `list --json` shows it; instants are seconds since 1970 or None."""
    return {
        "task_id": task.task_id,
        "task_type": task.task_type,
        "target": task.target,
        "priority": task.priority,
        "state": task.state,
        "estimated_time": task.estimated_time,
        "accepted_estimate": task.accepted_estimate,
        "progress": task.progress,
        "message": task.message,
        "robot": task.robot,
        "client": task.client,
        "submitted": instant(task.submitted),
        "started": instant(task.started),
        "ended": instant(task.ended),
    }


def whole_object(task: TaskInfo) -> dict[str, object]:
    """Return everything about a task as JSON values."""
    changes = [{"seconds": each.seconds, "cause": each.cause} for each in task.estimate_changes]
    return {**as_object(task), "result": result(task), "estimate_changes": changes}


def instant(stamp: Time) -> float | None:
    """Return a Time message as seconds since 1970, None if it is not set."""
    return stamp.sec + stamp.nanosec / 1e9 if stamp.sec or stamp.nanosec else None


def _robot(task: TaskInfo) -> str:
    """Return the robot of a task; in brackets if it is only planned."""
    robot = printable(task.robot)
    return f"({robot})" if robot and task.state == task.QUEUED else robot


def _is_begun(task: TaskInfo) -> bool:
    return bool(task.started.sec and not task.ended.sec)


def _outlook(task: TaskInfo) -> str:
    if task.ended.sec:
        return ""
    if task.state == task.QUEUED and task.message:  # such as: waits for robot_3, which is away
        return printable(task.message)
    percent = f" ({_percent(task)})" if _is_begun(task) else ""
    return f"{in_seconds(task.estimated_time)}{percent}"


def in_seconds(estimate: float) -> str:
    """Return an estimate as text; a negative one as `0.0 s`."""
    return f"{max(0.0, estimate):.1f} s"


def _percent(task: TaskInfo) -> str:
    return f"{task.progress:.0%}"


def _clock(stamp: Time) -> str:
    seconds = instant(stamp)
    if seconds is None:
        return ""
    return datetime.fromtimestamp(seconds).astimezone().isoformat(" ", "milliseconds")


def _brief(value: Any) -> str:
    """Return a value of a result in one line; for a long list, its range."""
    if isinstance(value, list) and len(value) > _LONG and all(map(_is_number, value)):
        return f"{len(value)} values from {min(value):g} to {max(value):g}"
    if isinstance(value, dict) and all(map(_is_number, value.values())):
        return ", ".join(f"{name} {number:g}" for name, number in value.items())
    return f"{value:g}" if _is_number(value) else printable(json.dumps(value, ensure_ascii=False))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
