"""Responses of the task server: their texts, as sentences for users, and tasks as ROS messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import msgspec

import srvgen
from taskrpc.errors import TaskRpcError, text_for_callers
from taskrpc.robot.tasks.model import PRIORITY_MAX, PRIORITY_MIN, EstimateChange, Task, TaskState

if TYPE_CHECKING:
    from srvgen.stubs.builtin_interfaces.msg import Time
    from srvgen.stubs.taskrpc_interfaces.msg import TaskInfo

SERVER_ENDED = "the server ended while it ran"
"""The message of a task that ran when its server ended."""

_LISTED = 3  # tasks that one sentence names
_EARLIEST, _LATEST = -(2.0**31), 2.0**31 - 1  # the range of builtin_interfaces/msg/Time


class TaskResponse(msgspec.Struct, frozen=True):
    """The response to a request that changes tasks."""

    success: bool
    message: str
    """One sentence for the user, also after a success."""
    task_id: int = -1
    """The id of the task; -1 if the request was refused."""
    estimated_time: float = 0.0
    """Robot seconds from now to the task's end."""


class Resumed(msgspec.Struct, frozen=True):
    """The tasks that a new server found in the store; its `str` is a sentence for the user."""

    queued: int
    """The number of tasks that are queued again."""
    interrupted: tuple[int, ...]
    """The interrupted tasks that no operator has requeued or dropped yet."""
    paused: bool = False
    """Whether the queue is paused, as it was when the earlier server ended."""

    def __str__(self) -> str:
        if self == Resumed(0, ()):
            return "no earlier tasks wait"
        count = f"{self.queued or 'no'} queued task{'' if self.queued == 1 else 's'}"
        notes = [
            f"task {task_id} was interrupted ({_decision_hint(task_id)})"
            for task_id in self.interrupted
        ]
        listed, hidden = notes[:_LISTED], len(notes) - _LISTED
        more = [f"{hidden} more were interrupted (taskrpc task list --all)"] if hidden > 0 else []
        if self.paused:
            more.append("the queue is still paused (taskrpc task resume continues it)")
        return "; ".join([f"resumed {count}", *listed, *more])


def task_queued(task: Task, estimated_time: float, *, paused: bool, note: str = "") -> TaskResponse:
    """Return the response to a submission that was accepted; `note` says what the task waits for.

    `paused`: whether the queue is paused.
    """
    message = f"Task queued: {task.task_type}{_notes(note, paused=paused)}"
    return TaskResponse(True, message, task.task_id, estimated_time)


def task_possible(
    task_type: str, estimated_time: float, *, paused: bool, note: str = ""
) -> TaskResponse:
    """Return the response about a task that would be accepted; the arguments as `task_queued`."""
    added = _notes(note, paused=paused)
    return TaskResponse(True, f"Task would be queued: {task_type}{added}", -1, estimated_time)


def _notes(note: str, *, paused: bool) -> str:
    notes = [each for each in (note, "the queue is paused" if paused else "") if each]
    return f" ({'; '.join(notes)})" if notes else ""


def refused(task: Task | None, task_id: int, rule: str) -> TaskResponse:
    """Return the response to a request that a task's state does not allow, with the rule."""
    if task is None:
        return TaskResponse(False, f"There is no task {task_id}")
    return TaskResponse(False, f"Task {task_id} is {task.state.value}: {rule}")


def no_fleet(robot: str) -> TaskResponse:
    """Return the refusal of a request for one robot by a server that has no fleet."""
    return TaskResponse(
        False,
        f"There is no robot {printable(robot)!r}: this server drives one robot without a name and"
        " belongs to no fleet; leave the robot's name out",
    )


def unknown_type(task_type: str, expected: Sequence[str]) -> str:
    """Return the refusal of a type of task that no robot has."""
    types = " or ".join(", ".join(expected).rsplit(", ", 1))
    return f"Invalid task: {printable(task_type)} (expected {types})"


def queue_full(waiting: int, limit: int) -> str:
    """Return the refusal of a task for which the queue has no place."""
    return f"Queue full (waiting: {waiting}, limit: {limit})"


def share_full(account: str, machine: str, waiting: int, share: int) -> str:
    """Return the refusal of a task of an account that has too many tasks."""
    whose = f"{account} at {machine}" if machine else account
    return f"Share full: {whose} (waiting: {waiting}, limit for one account: {share})"


def priority_refusal(priority: int) -> str:
    """Return what is wrong with a priority, "" if it is valid."""
    if PRIORITY_MIN <= priority <= PRIORITY_MAX:
        return ""
    allowed = f"{PRIORITY_MIN} to {PRIORITY_MAX}, {PRIORITY_MAX} runs first"
    return f"Invalid priority: {priority} (expected {allowed})"


def _decision_hint(task_id: int) -> str:
    return f"decide with taskrpc task resume {task_id}, requeue {task_id} or drop {task_id}"


def requeue_hint(task_id: int) -> str:
    """Return how to run an ended task again."""
    return f"taskrpc task requeue {task_id} runs it again"


def unstored_note(error: TaskRpcError) -> str:
    """Return what to add about a change that was made although the store refused it."""
    return f", but this could not be stored: {text_for_callers(error)}"


def commanded(said: str, failure: str) -> TaskResponse:
    """Return the response to a pause, resume or stop that was stored.

    `failure` says why the robot did not follow, "" if it did.
    """
    return TaskResponse(False, f"{said}, but {failure}") if failure else TaskResponse(True, said)


def stopped_note(tasks: Sequence[Task]) -> str:
    """Return what to add to the response to a stop about the tasks that ran, as they are now."""
    notes = [
        f"; task {task.task_id} was cancelled ({requeue_hint(task.task_id)})"
        if task.state is TaskState.CANCELED
        else f"; task {task.task_id} is being cancelled"
        for task in tasks
        if task.state is TaskState.CANCELED or not task.state.is_ended
    ]
    hidden = len(notes) - _LISTED
    more = f"; {hidden} more are listed by taskrpc task list --all" if hidden > 0 else ""
    return "".join(notes[:_LISTED]) + more


def queue_text(waiting: int, *doing: str, paused: bool, interrupted: int) -> str:
    """Return the state of a queue as a sentence for users.

    Args:
        waiting: the number of queued tasks.
        doing: what the robots do.
        paused: whether the queue is paused.
        interrupted: the number of interrupted tasks.
    """
    parts = [f"{waiting or 'no'} task{'' if waiting == 1 else 's'} in the queue", *doing]
    if paused:
        parts.append("the queue is paused")
    if interrupted:
        tasks = "interrupted task waits" if interrupted == 1 else "interrupted tasks wait"
        parts.append(f"{interrupted} {tasks} for a decision (taskrpc task list --all)")
    return ", ".join(parts)


def by_client(action: str, client: str) -> str:
    """Return an action with the client that requested it, if that is known."""
    return f"{action} by {client}" if client else action


def printable(text: str) -> str:
    """Return a client's text, cleaned and cut for one line of a terminal."""
    clean = "".join(letter if letter.isprintable() else "?" for letter in text)
    return clean if len(clean) <= 60 else clean[:59] + "…"


class TaskMessages:
    """Converts tasks to messages of taskrpc_interfaces; loads their classes when constructed."""

    def __init__(self) -> None:
        self._task_info = srvgen.load("taskrpc_interfaces/msg/TaskInfo")
        self._estimate_change = srvgen.load("taskrpc_interfaces/msg/EstimateChange")
        self._time = srvgen.load("builtin_interfaces/msg/Time")

    def task_info(
        self, task: Task, estimated_time: float, robot: str = "", waits_for: str = ""
    ) -> TaskInfo:
        """Return a TaskInfo for a list: without the result and the estimate's changes.

        `robot` is the robot that is planned to execute a queued task of a fleet; `waits_for` says
        which robots it waits for while none of them works.
        """
        return self._task_info(
            task_id=task.task_id,
            task_type=task.task_type,
            target=task.target,
            priority=task.priority,
            state=task.state.value,
            estimated_time=estimated_time,
            accepted_estimate=task.accepted_estimate,
            progress=task.progress,
            message=task.message or waits_for,
            client=task.client,
            submitted=self._instant(task.submitted_at),
            started=self._instant(task.started_at),
            ended=self._instant(task.ended_at),
            robot=task.robot or robot,
        )

    def whole_task_info(
        self,
        task: Task,
        estimated_time: float,
        changes: Iterable[EstimateChange],
        robot: str = "",
        waits_for: str = "",
    ) -> TaskInfo:
        """Return a TaskInfo with the result and the estimate's changes."""
        info = self.task_info(task, estimated_time, robot, waits_for)
        info.result = task.result
        info.estimate_changes = [
            self._estimate_change(**msgspec.structs.asdict(change)) for change in changes
        ]
        return info

    def _instant(self, seconds: float | None) -> Time:
        # A wall clock may have been wrong by decades. One such task must not make the whole list
        # impossible to send.
        whole, fraction = divmod(min(max(seconds or 0.0, _EARLIEST), _LATEST), 1)
        return self._time(sec=int(whole), nanosec=int(fraction * 1e9))
