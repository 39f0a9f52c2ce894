"""Compares the estimates of the demo's tasks with their actual times, from the server's records."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from taskrpc.cli.robot.task.view import aligned, change, instant
from taskrpc.observe.texts import work_of

_SHARE = 0.01  # of the actual time: the largest difference of a correct estimate
_BUSY_SHARE = 0.05  # the same on a busy computer, whose timers are late
_LEAST = 0.01  # robot seconds: a smaller difference never counts
_NAMED = 0.3  # robot seconds: smaller changes get no line


class EstimateCheck(msgspec.Struct, frozen=True):
    """One task's estimate and actual time, in robot seconds from its acceptance to its end."""

    task: Any
    """The TaskInfo message."""
    turn: int
    """Its place in the order in which the tasks ran, from 1; 0 if it never ran."""
    actual: float
    """The actual time."""

    @property
    def changes(self) -> float:
        """The delay by later changes of the queue, such as a new task with a higher priority.

        A task that took longer than planned does not count: then the estimate was wrong.
        """
        return float(sum(each.seconds for each in self.task.estimate_changes if _explains(each)))

    @property
    def difference(self) -> float:
        """How much later than its estimate and the changes it ended; negative if earlier."""
        return float(self.actual - self.task.accepted_estimate - self.changes)

    @property
    def share(self) -> float:
        """The difference as a share of the actual time."""
        return self.difference / self.actual if self.actual else 0.0

    @property
    def is_right(self) -> bool:
        """Whether estimate and changes add up to the actual time, within 1 % or 10 ms."""
        return abs(self.difference) <= max(_LEAST, _SHARE * self.actual)

    @property
    def is_wrong(self) -> bool:
        """Whether the difference is larger than late timers of a busy computer explain."""
        return abs(self.difference) > max(_LEAST, _BUSY_SHARE * self.actual)


def check_estimates(tasks: Iterable[Any], speed: float) -> list[EstimateCheck]:
    """Check the estimates of ended tasks, in the order of their start; tasks without a start last.

    `speed` is in robot seconds per second.
    """
    ended = sorted(tasks, key=lambda task: instant(task.started) or float("inf"))
    turns = {task.task_id: n for n, task in enumerate(ended, 1) if instant(task.started)}
    return [
        EstimateCheck(task, turns.get(task.task_id, 0), _lasted(task) * speed) for task in ended
    ]


def are_right(rows: Sequence[EstimateCheck]) -> bool:
    """Whether all tasks that ran SUCCEEDED, and none of their estimates was wrong."""
    ran = [row for row in rows if row.turn]
    return bool(ran) and not any(
        row.task.state != row.task.SUCCEEDED or row.is_wrong for row in ran
    )


def summary(rows: Sequence[EstimateCheck]) -> list[str]:
    """Return the checks as a table, the reasons for changes, and the verdict."""
    head = ("ran", "task", "client", "priority", "promised", "changes", "actual", "off by")
    lines = aligned([head, *map(_row, rows)], right={0, 3, 4, 5, 6, 7})
    return [*lines, "", *_reasons(rows), "", *_verdict(rows)]


def _explains(change_: Any) -> bool:
    return not change_.cause.endswith(("than planned", "server was late"))


def _percent(share: float) -> str:
    return f"{round(100 * share, 2) + 0.0:+.2f} %"  # never "-0.00 %"


def _lasted(task: Any) -> float:
    return (instant(task.ended) or 0.0) - (instant(task.submitted) or 0.0)


def _row(row: EstimateCheck) -> tuple[str, ...]:
    task = row.task
    head = (f"{task.task_id} {work_of(task)}", task.client.lstrip("/"), str(task.priority))
    promised = f"{task.accepted_estimate:.1f} s"
    if not row.turn:
        return ("-", *head, promised, "", task.state, "")
    figures = (f"{row.changes:+.1f} s", f"{row.actual:.1f} s", _percent(row.share))
    return (str(row.turn), *head, promised, *figures)


def _reasons(rows: Iterable[EstimateCheck]) -> list[str]:
    """Return a line for each large change, with the tasks that it moved."""
    moved: dict[str, list[str]] = {}
    for row in rows:
        for each in row.task.estimate_changes if row.turn else ():
            if abs(each.seconds) >= _NAMED and _explains(each):
                moved.setdefault(change(each), []).append(str(row.task.task_id))
    return [f"Why estimates changed (by {_NAMED} s or more):"] + [
        f"  {reason} (moved {', '.join(numbers)})" for reason, numbers in moved.items()
    ]


def _verdict(rows: Sequence[EstimateCheck]) -> list[str]:
    ran = [row for row in rows if row.turn]
    wrong = [row for row in ran if row.is_wrong]
    failed = [row for row in ran if row.task.state != row.task.SUCCEEDED]
    lines = [
        f"Task {row.task.task_id} ended {row.task.state}: {row.task.message}" for row in failed
    ]
    if wrong:
        numbers = ", ".join(f"{row.task.task_id} by {row.difference:+.2f} s" for row in wrong)
        return [*lines, f"These estimates were wrong by more than 5 %: task {numbers}."]
    if not ran:
        return [*lines, "No task ran."]
    worst = max(ran, key=lambda row: abs(row.share))
    if not worst.is_right:
        return [
            *lines,
            f"Task {worst.task.task_id} is off most, by {_percent(worst.share)}: this computer is"
            " busy, and its timers are late.",
        ]
    return [
        *lines,
        f"All {len(ran)} estimates were right: what was promised and the named changes add up to",
        f"the actual time. Task {worst.task.task_id} is off most, by {_percent(worst.share)}.",
    ]
