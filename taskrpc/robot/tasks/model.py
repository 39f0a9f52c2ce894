"""A task, its states and its order: plain values, no clock and no I/O."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import TypeAlias

import msgspec

PRIORITY_MIN = 1
"""The lowest priority."""
PRIORITY_MAX = 10
"""The highest priority: its tasks run first."""

DECISIONS = 16
"""The most decisions of clients that a task keeps."""

OrderKey: TypeAlias = tuple[int, int]
"""A task's place in the order of execution: `(level, arrival)`. The smaller key runs earlier.

`Task.order_key` is the only definition of that order. The heap, the schedule, the estimates and
the pages of a listing all compare its keys.
"""

LEVELS = range(-PRIORITY_MAX, -PRIORITY_MIN + 1)
"""The first component of the queued tasks' keys, in the order of execution."""
RUNNING_KEY: OrderKey = (LEVELS[0] - 1, 0)
"""The key of the running task: before every queued task."""
_LAST_ARRIVAL = 2**62  # behind all tasks of a priority
BEFORE_RUNNING_KEY: OrderKey = (LEVELS[0] - 2, 0)
"""A key before the running task."""


class TaskState(Enum):
    """The state of a task; the value is the name that users see."""

    QUEUED = "QUEUED"
    """It waits in the queue."""
    RUNNING = "RUNNING"
    """The robot executes it."""
    PAUSED = "PAUSED"
    """It has begun; the robot stands still until the queue is resumed."""
    CANCELING = "CANCELING"
    """It has begun; the robot is about to halt."""
    SUCCEEDED = "SUCCEEDED"
    """The robot has completed it."""
    FAILED = "FAILED"
    """The robot could not complete it."""
    CANCELED = "CANCELED"
    """A client cancelled it."""
    INTERRUPTED = "INTERRUPTED"
    """It was running when the server ended, so its progress is unknown."""

    @property
    def is_begun(self) -> bool:
        """Whether the robot has begun it and not ended it."""
        return self in BEGUN

    @property
    def is_ended(self) -> bool:
        """Whether it has ended; only a requeue changes it again."""
        return self is not TaskState.QUEUED and self not in BEGUN


BEGUN = frozenset({TaskState.RUNNING, TaskState.PAUSED, TaskState.CANCELING})
"""The states of the one task that the robot executes."""

_ENDINGS = {TaskState.SUCCEEDED, TaskState.FAILED, TaskState.CANCELED, TaskState.INTERRUPTED}

TRANSITIONS: Mapping[TaskState, frozenset[TaskState]] = MappingProxyType(
    {
        TaskState.QUEUED: frozenset({TaskState.RUNNING, TaskState.CANCELED}),
        TaskState.RUNNING: frozenset({TaskState.PAUSED, TaskState.CANCELING} | _ENDINGS),
        TaskState.PAUSED: frozenset({TaskState.RUNNING, TaskState.CANCELING} | _ENDINGS),
        TaskState.CANCELING: frozenset(_ENDINGS),  # it may complete before the robot halts
        TaskState.SUCCEEDED: frozenset(),
        TaskState.FAILED: frozenset({TaskState.QUEUED}),
        TaskState.CANCELED: frozenset({TaskState.QUEUED}),
        TaskState.INTERRUPTED: frozenset({TaskState.QUEUED, TaskState.CANCELED}),
    }
)
"""The states that may follow each state."""


class EstimateChange(msgspec.Struct, frozen=True, gc=False):
    """One reason why a task ends later or earlier than its accepted estimate says."""

    seconds: float
    """Robot seconds by which the task ends later; negative: earlier."""
    cause: str
    """What happened, as users read it."""


class ClientDecision(msgspec.Struct, frozen=True, gc=False):
    """A client's decision about a task that was submitted before."""

    at: float
    """When it was made, in seconds since 1970."""
    client: str
    """The client that made it: an account or a node; empty if unknown."""
    action: str
    """What it did to the task, such as `cancelled` or `moved to priority 8`."""

    def is_like(self, other: ClientDecision) -> bool:
        """Return whether the same client has decided the same."""
        return (self.client, self.action) == (other.client, other.action)


class Task(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """An immutable snapshot of one task; each change makes a new value.

    Instants are seconds since 1970 on the wall clock. Estimates are robot seconds.
    """

    task_id: int
    """Counts up from 1; no id is used twice."""
    task_type: str
    """One of the robot's task types."""
    target: str
    """The target as the client wrote it."""
    priority: int
    """`PRIORITY_MIN` to `PRIORITY_MAX`."""
    arrival: int
    """Counts the tasks that entered the queue; among equal priorities the smaller runs first."""
    submitted_at: float
    """When it was queued; after a requeue, when that happened."""
    state: TaskState = TaskState.QUEUED
    started_at: float | None = None
    """When the robot began it; None before."""
    ended_at: float | None = None
    """When it ended; None before."""
    accepted_estimate: float = 0.0
    """The estimate that the client got: robot seconds from `submitted_at` to its end."""
    progress: float = 0.0
    """The completed part, 0.0 to 1.0."""
    message: str = ""
    """Why it ended in its state."""
    result: str = ""
    """The robot's result as JSON text; empty unless it SUCCEEDED."""
    client: str = ""
    """The client that submitted it: an account or a node."""
    machine: str = ""
    """The address that an account submitted it from; empty without an account."""
    changes: tuple[EstimateChange, ...] = ()
    """Why it did not end at its accepted estimate; filled in when it ends."""
    robot: str = ""
    """The robot of a fleet that executes or executed it; empty before, and without a fleet."""

    decisions: tuple[ClientDecision, ...] = ()
    """The newest decisions of clients about it, at most `DECISIONS`, oldest first."""

    @classmethod
    def possible(cls, task_type: str, target: str, priority: int, now: float) -> Task:
        """Return a task that is not queued, as if it were submitted now; it has no id."""
        return cls(
            task_id=0,
            task_type=task_type,
            target=target,
            priority=priority,
            arrival=_LAST_ARRIVAL,
            submitted_at=now,
        )

    @property
    def order_key(self) -> OrderKey:
        """Its place in the order of execution: priority 10 first, equal priorities by arrival."""
        return (-self.priority, self.arrival)

    @property
    def may_become(self) -> frozenset[TaskState]:
        """The states that may follow its own."""
        return TRANSITIONS[self.state]

    def moved_to(self, state: TaskState, *, message: str = "") -> Task:
        """Return the same task in another state.

        Raises:
            ValueError: `TRANSITIONS` does not allow it.
        """
        if state not in self.may_become:
            raise ValueError(
                f"task {self.task_id} is {self.state.value} and cannot become {state.value}"
            )
        return msgspec.structs.replace(self, state=state, message=message)

    def decided(self, at: float, client: str, action: str) -> Task:
        """Return the same task with one more decision of a client."""
        return self.with_decisions(ClientDecision(at, client, action))

    def with_decisions(self, *decisions: ClientDecision) -> Task:
        """Return the same task with further decisions of clients.

        A decision counts once, also if the same client repeats it at once.
        """
        known = list(self.decisions)
        for each in decisions:
            is_repeated = bool(known) and known[-1].is_like(each)
            if not is_repeated and each not in known:
                known.append(each)
        return msgspec.structs.replace(self, decisions=tuple(known[-DECISIONS:]))

    def started(self, at: float) -> Task:
        """Return the same task, RUNNING since `at`."""
        running = self.moved_to(TaskState.RUNNING)
        return msgspec.structs.replace(running, started_at=at, progress=0.0)

    def ended(self, state: TaskState, at: float, *, message: str = "", result: str = "") -> Task:
        """Return the same task, ended in `state` at `at`."""
        moved = self.moved_to(state, message=message)
        progress = 1.0 if state is TaskState.SUCCEEDED else self.progress
        return msgspec.structs.replace(moved, ended_at=at, result=result, progress=progress)

    def requeued(self, at: float, arrival: int) -> Task:
        """Return the same task, QUEUED at `at` in the place that `arrival` gives it."""
        return msgspec.structs.replace(
            self.moved_to(TaskState.QUEUED),
            arrival=arrival,
            submitted_at=at,
            started_at=None,
            ended_at=None,
            progress=0.0,
            result="",
            changes=(),
            robot="",
        )
