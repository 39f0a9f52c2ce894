"""The rules for requests of clients: what a request does to a task. All rules are pure.

A rule gets the task as it is stored, None if there is none, and returns a decision. `TaskManager`
carries the decisions out for one robot, `FleetManager` in transactions of a fleet.
"""

from __future__ import annotations

from collections.abc import Callable, Sized
from typing import Protocol, TypeAlias

import msgspec

from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.responses import (
    TaskResponse,
    by_client,
    priority_refusal,
    queue_full,
    refused,
    requeue_hint,
    share_full,
)

# Decisions. A `TaskResponse` is one too: it is the response, and nothing changes.


class Change(msgspec.Struct, frozen=True):
    """The task gets another value."""

    task: Task
    """The new value."""
    message: str
    """The response's message, once the value is stored."""


class Halt(msgspec.Struct, frozen=True):
    """The robot that executes the task must halt; `halted` makes the response."""

    task: Task
    """The task, CANCELING."""


class Enqueue(msgspec.Struct, frozen=True):
    """The ended task is queued again."""

    task: Task
    """The task as it ended."""
    keeps_arrival: bool
    """Whether it keeps its arrival, and so its place among tasks of its priority."""


Decision: TypeAlias = TaskResponse | Change | Halt | Enqueue


class Queue(Sized, Protocol):
    """The queued tasks, as far as a refusal depends on them."""

    def count_waiting(self, account: str, machine: str) -> int:
        """Return the number of queued tasks that an account submitted from a machine."""


# Rules


def refusal(
    unable: str,
    priority: int,
    queue: Queue,
    limit: int,
    share: int | None = None,
    account: str = "",
    machine: str = "",
) -> str:
    """Return why a task is not queued, "" if it is.

    Args:
        unable: why no robot can execute it, "" if one can.
        priority: its priority.
        queue: the queued tasks.
        limit: how many tasks may wait.
        share: how many of them one account may have from one machine; None for no limit.
        account: the account that submits it, "" without one: then its share is not limited.
        machine: the address that the account submits it from.
    """
    if unable:
        return unable
    if problem := priority_refusal(priority):
        return problem
    if len(queue) >= limit:
        return queue_full(len(queue), limit)
    if share is not None and account:
        waiting = queue.count_waiting(account, machine)
        if waiting >= share:
            return share_full(account, machine, waiting, share)
    return ""


def cancel(
    task: Task | None, task_id: int, now: float, client: str
) -> TaskResponse | Change | Halt:
    """Cancel a queued or running task."""
    if task is not None:
        reason = by_client("cancelled", client)
        if task.state is TaskState.QUEUED:
            return _cancelled(task.decided(now, client, "cancelled"), now, reason)
        if task.state is TaskState.CANCELING:  # the first reason counts
            return Halt(task)
        if task.state.is_begun:
            halting = task.moved_to(TaskState.CANCELING, message=reason)
            return Halt(halting.decided(now, client, "cancelled"))
        if task.state is TaskState.CANCELED:
            return TaskResponse(True, f"Task {task_id} is cancelled already", task_id)
    return refused(task, task_id, _TOO_LATE)


def halted(task: Task, *, is_over: bool) -> TaskResponse:
    """Return the response to a cancel whose robot had some time to halt.

    `task` is the task after this time; `is_over`: whether its execution has ended.
    """
    task_id = task.task_id
    if not is_over:
        return TaskResponse(True, f"Task {task_id} is being cancelled", task_id)
    if task.state is TaskState.CANCELED:
        return TaskResponse(True, f"Task {task_id} was cancelled", task_id)
    return refused(task, task_id, _TOO_LATE)


def drop(task: Task | None, task_id: int, now: float, client: str) -> TaskResponse | Change:
    """Cancel a queued or interrupted task."""
    if task is not None:
        reason = by_client("dropped", client)
        if task.state is TaskState.QUEUED:
            return _cancelled(task.decided(now, client, "dropped"), now, reason)
        if task.state is TaskState.INTERRUPTED:
            ended = task.ended(TaskState.CANCELED, now, message=reason)
            return Change(ended.decided(now, client, "dropped"), f"Task {task_id} was dropped")
        if task.state is TaskState.CANCELED:
            return TaskResponse(True, f"Task {task_id} is dropped already", task_id)
    return refused(task, task_id, "only a queued or interrupted task can be dropped")


def reprioritise(
    task: Task | None, task_id: int, priority: int, now: float, client: str
) -> TaskResponse | Change:
    """Change the priority of a queued task."""
    if problem := priority_refusal(priority):
        return TaskResponse(False, problem)
    if task is None or task.state is not TaskState.QUEUED:
        return refused(task, task_id, "only a queued task can be moved")
    moved = msgspec.structs.replace(task, priority=priority)
    if priority != task.priority:
        moved = moved.decided(now, client, f"moved to priority {priority}")
    return Change(moved, f"Task {task_id} has priority {priority}")


def requeue(
    task: Task | None,
    task_id: int,
    now: float,
    client: str,
    *,
    resume: bool,
    refusal: Callable[[Task], str],
) -> TaskResponse | Enqueue:
    """Queue an interrupted, failed or cancelled task again; with `resume`, in its old place.

    `refusal` returns why the task is not queued, "" if it is.
    """
    if task is not None and task.state is TaskState.QUEUED:
        return TaskResponse(True, f"Task {task_id} is queued already", task_id)
    if task is None or TaskState.QUEUED not in task.may_become:
        rule = "only an interrupted, failed or cancelled task can be queued again"
        return refused(task, task_id, rule)
    if resume and task.state is not TaskState.INTERRUPTED:
        rule = f"only an interrupted task can be resumed; {requeue_hint(task_id)}"
        return refused(task, task_id, rule)
    if problem := refusal(task):
        return TaskResponse(False, problem)
    decided = task.decided(now, client, "resumed" if resume else "queued again")
    return Enqueue(decided, keeps_arrival=resume)


_TOO_LATE = "cannot be cancelled any more"


def _cancelled(task: Task, now: float, reason: str) -> Change:
    ended = task.ended(TaskState.CANCELED, now, message=reason)
    return Change(ended, f"Task {task.task_id} was cancelled")
