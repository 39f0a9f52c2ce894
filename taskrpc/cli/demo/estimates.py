"""What the demo's tasks were promised and what became of it, computed from the server's records."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from taskrpc.cli.task.view import aligned, change, instant, what

_SHARE = 0.01
_BUSY_SHARE = 0.05
_LEAST = 0.01  # robot seconds
_NAMED = 0.3  # robot seconds of a change that is worth a line


@dataclass(frozen=True, slots=True)
class Account:
    """One task's promise and its real time, in robot seconds from its acceptance to its end."""

    task: Any
    """The TaskInfo message."""
    turn: int
    """The how manieth it ran; 0 if it never did."""
    actual: float

    @property
    def changes(self) -> float:
        """By how much later it was to be done because somebody changed the queue.

        That a task took longer than planned is no reason for a wrong estimate, but one.
        """
        return float(sum(each.seconds for each in self.task.estimate_changes if _explains(each)))

    @property
    def difference(self) -> float:
        """By how much later it was done than promised, the named changes added."""
        return float(self.actual - self.task.accepted_estimate - self.changes)

    @property
    def share(self) -> float:
        """The difference as a share of the real time."""
        return self.difference / self.actual if self.actual else 0.0

    @property
    def is_right(self) -> bool:
        """Whether promise and changes are its real time, within 1 % or 10 ms."""
        return abs(self.difference) <= max(_LEAST, _SHARE * self.actual)

    @property
    def is_wrong(self) -> bool:
        """Whether it is off by more than a busy computer's late timers explain."""
        return abs(self.difference) > max(_LEAST, _BUSY_SHARE * self.actual)


def accounts(tasks: Iterable[Any], speed: float) -> list[Account]:
    """The accounts of ended tasks, by the order in which they ran, then those that never did.

    `speed` is in robot seconds a second.
    """
    ended = sorted(tasks, key=lambda task: instant(task.started) or float("inf"))
    turns = {task.task_id: n for n, task in enumerate(ended, 1) if instant(task.started)}
    return [Account(task, turns.get(task.task_id, 0), _lasted(task) * speed) for task in ended]


def are_right(rows: Sequence[Account]) -> bool:
    """Whether every task SUCCEEDED that ran, and none of their estimates was wrong."""
    ran = [row for row in rows if row.turn]
    return bool(ran) and not any(
        row.task.state != row.task.SUCCEEDED or row.is_wrong for row in ran
    )


def summary(rows: Sequence[Account]) -> list[str]:
    """The accounts as a table, the reasons below it, and the verdict."""
    head = ("ran", "task", "client", "priority", "promised", "changes", "actual", "off by")
    lines = aligned([head, *map(_row, rows)], right={0, 3, 4, 5, 6, 7})
    return [*lines, "", *_reasons(rows), "", *_verdict(rows)]


def _explains(change_: Any) -> bool:
    return not change_.cause.endswith(("than planned", "server was late"))


def _percent(share: float) -> str:
    return f"{round(100 * share, 2) + 0.0:+.2f} %"  # never "-0.00 %"


def _lasted(task: Any) -> float:
    return (instant(task.ended) or 0.0) - (instant(task.submitted) or 0.0)


def _row(row: Account) -> tuple[str, ...]:
    task = row.task
    head = (f"{task.task_id} {what(task)}", task.client.lstrip("/"), str(task.priority))
    promised = f"{task.accepted_estimate:.1f} s"
    if not row.turn:
        return ("-", *head, promised, "", task.state, "")
    figures = (f"{row.changes:+.1f} s", f"{row.actual:.1f} s", _percent(row.share))
    return (str(row.turn), *head, promised, *figures)


def _reasons(rows: Iterable[Account]) -> list[str]:
    """Each change that was worth a word, with the tasks that it moved."""
    moved: dict[str, list[str]] = {}
    for row in rows:
        for each in row.task.estimate_changes if row.turn else ():
            if abs(each.seconds) >= _NAMED and _explains(each):
                moved.setdefault(change(each), []).append(str(row.task.task_id))
    return [f"Why estimates changed (by {_NAMED} s or more):"] + [
        f"  {reason} (moved {', '.join(numbers)})" for reason, numbers in moved.items()
    ]


def _verdict(rows: Sequence[Account]) -> list[str]:
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
