"""The texts of responses about tasks, as sentences for users."""

from __future__ import annotations

import msgspec

from taskrpc.errors import TaskRpcError, told
from taskrpc.tasks.model import PRIORITY_MAX, PRIORITY_MIN


class Answer(msgspec.Struct, frozen=True):
    """What became of a request."""

    success: bool
    message: str
    """One sentence for the user, also when all went well."""
    task_id: int = -1
    """The task in question, -1 if it was refused."""
    estimated_time: float = 0.0
    """Robot seconds from now until that task is done."""


class Resumed(msgspec.Struct, frozen=True):
    """What a new server found of the tasks of the one before."""

    queued: int
    """How many tasks wait again."""
    interrupted: tuple[int, ...]
    """The tasks that ran when a server ended and about which nobody has decided yet."""
    paused: bool = False
    """Whether the queue stands still, as it did when the server before ended."""

    def __str__(self) -> str:
        if self == Resumed(0, ()):
            return "no earlier tasks wait"
        count = f"{self.queued or 'no'} queued task{'' if self.queued == 1 else 's'}"
        notes = [f"task {number} was interrupted ({_ways(number)})" for number in self.interrupted]
        shown, hidden = notes[:3], len(notes) - 3
        more = [f"{hidden} more were interrupted (taskrpc task list --all)"] if hidden > 0 else []
        if self.paused:
            more.append("the queue is still paused (taskrpc task resume continues it)")
        return "; ".join([f"resumed {count}", *shown, *more])


def priority_refusal(priority: int) -> str:
    """What is wrong with a priority, an empty text if it is one."""
    if PRIORITY_MIN <= priority <= PRIORITY_MAX:
        return ""
    allowed = f"{PRIORITY_MIN} to {PRIORITY_MAX}, {PRIORITY_MAX} runs first"
    return f"Invalid priority: {priority} (expected {allowed})"


def _ways(task_id: int) -> str:
    return f"decide with taskrpc task resume {task_id}, requeue {task_id} or drop {task_id}"


def again(task_id: int) -> str:
    """How an ended task is run once more."""
    return f"taskrpc task requeue {task_id} runs it again"


def unstored(error: TaskRpcError) -> str:
    """What is said of something that was done although the store refused it."""
    return f", but a restart would not know it: {told(error)}"


def by(what: str, client: str) -> str:
    """What was done, and by whom if that is known."""
    return f"{what} by {client}" if client else what


def shown(text: str) -> str:
    """A user's text, fit for one line of a terminal."""
    shown = "".join(letter if letter.isprintable() else "?" for letter in text)
    return shown if len(shown) <= 60 else shown[:59] + "…"
