"""A task and the states that it goes through: plain values, no clock and no I/O."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import TypeAlias

import msgspec

PRIORITY_MIN = 1
"""The lowest priority."""
PRIORITY_MAX = 10
"""The priority that runs first."""

Key: TypeAlias = tuple[int, int]
"""The place in the order of run: (-priority, arrival). What is smaller runs earlier."""


class State(Enum):
    """Where a task is in its life; the value is the name that users see."""

    QUEUED = "QUEUED"
    """Waits for its turn."""
    RUNNING = "RUNNING"
    """The robot works on it."""
    PAUSED = "PAUSED"
    """Begun; the robot halts until the queue is resumed."""
    CANCELING = "CANCELING"
    """Begun; the robot is being halted."""
    SUCCEEDED = "SUCCEEDED"
    """Done."""
    FAILED = "FAILED"
    """The robot gave up."""
    CANCELED = "CANCELED"
    """Somebody called it off."""
    INTERRUPTED = "INTERRUPTED"
    """It ran when the server ended; nobody knows how far it came."""

    @property
    def is_begun(self) -> bool:
        """Whether the robot has it in hand."""
        return self in BEGUN

    @property
    def is_ended(self) -> bool:
        """Whether nothing more will happen to it unless it is queued once more."""
        return self is not State.QUEUED and self not in BEGUN


BEGUN = frozenset({State.RUNNING, State.PAUSED, State.CANCELING})
"""The states of the one task that the robot has in hand."""

_ENDINGS = {State.SUCCEEDED, State.FAILED, State.CANCELED, State.INTERRUPTED}

MOVES: Mapping[State, frozenset[State]] = MappingProxyType(
    {
        State.QUEUED: frozenset({State.RUNNING, State.CANCELED}),
        State.RUNNING: frozenset({State.PAUSED, State.CANCELING} | _ENDINGS),
        State.PAUSED: frozenset({State.RUNNING, State.CANCELING} | _ENDINGS),
        State.CANCELING: frozenset(_ENDINGS),  # the robot may be done before it could be halted
        State.SUCCEEDED: frozenset(),
        State.FAILED: frozenset({State.QUEUED}),
        State.CANCELED: frozenset({State.QUEUED}),
        State.INTERRUPTED: frozenset({State.QUEUED, State.CANCELED}),
    }
)
"""Every move from one state to another that a task may make."""


class EstimateChange(msgspec.Struct, frozen=True, gc=False):
    """One reason why a task will be done at another time than was promised."""

    seconds: float
    """Robot seconds by which it will be done later; negative: earlier."""
    cause: str
    """What happened, as a user reads it."""


class Task(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """One task as it was at one moment; a change makes a new value.

    Instants are seconds since 1970 (the wall clock's), estimates are robot seconds.
    """

    task_id: int
    """From 1 upwards, never used twice."""
    task_type: str
    """One of the robot's task types."""
    target: str
    """As it was submitted."""
    priority: int
    """`PRIORITY_MIN` to `PRIORITY_MAX`."""
    arrival: int
    """Counts what entered the queue; among equal priorities the smaller one runs first."""
    submitted_at: float
    """When it was queued, the last time if more than once."""
    state: State = State.QUEUED
    started_at: float | None = None
    ended_at: float | None = None
    accepted_estimate: float = 0.0
    """What was promised when it was queued: seconds from then until it is done."""
    progress: float = 0.0
    """0.0 to 1.0."""
    message: str = ""
    """Why it ended as it did."""
    result: str = ""
    """What the robot found, as JSON text; empty until it succeeded."""
    client: str = ""
    """Who submitted it."""
    machine: str = ""
    """The address from which it came, where one account may have many machines."""
    changes: tuple[EstimateChange, ...] = ()
    """Why the promise was not kept to the second; filled in when it ends."""

    @property
    def key(self) -> Key:
        """Its place in the order of run."""
        return (-self.priority, self.arrival)

    @property
    def may_become(self) -> frozenset[State]:
        """The states into which it may move."""
        return MOVES[self.state]

    def moved_to(self, state: State, *, message: str = "") -> Task:
        """The same task in another state.

        Raises:
            ValueError: a task never moves so.
        """
        if state not in self.may_become:
            raise ValueError(
                f"task {self.task_id} is {self.state.value} and cannot become {state.value}"
            )
        return msgspec.structs.replace(self, state=state, message=message)

    def started(self, at: float) -> Task:
        """The same task, RUNNING since `at`."""
        return msgspec.structs.replace(self.moved_to(State.RUNNING), started_at=at, progress=0.0)

    def ended(self, state: State, at: float, *, message: str = "", result: str = "") -> Task:
        """The same task, ended in `state` at `at`."""
        moved = self.moved_to(state, message=message)
        progress = 1.0 if state is State.SUCCEEDED else self.progress
        return msgspec.structs.replace(moved, ended_at=at, result=result, progress=progress)

    def requeued(self, at: float, arrival: int) -> Task:
        """The same task at the place of `arrival` in its priority, as if submitted at `at`."""
        return msgspec.structs.replace(
            self.moved_to(State.QUEUED),
            arrival=arrival,
            submitted_at=at,
            started_at=None,
            ended_at=None,
            progress=0.0,
            result="",
            changes=(),
        )
