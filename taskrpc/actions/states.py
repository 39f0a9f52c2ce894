"""The states of a goal, as one table of the changes that are allowed.

A server accepts a goal, executes it, and ends it in one of three ways:

    ACCEPTED ── EXECUTE ─▶ EXECUTING ── SUCCEED ─▶ SUCCEEDED
        │                      ├─────── ABORT ───▶ ABORTED
        └───── CANCEL_GOAL ────┴─▶ CANCELING ── CANCELED ─▶ CANCELED
                                       └── SUCCEED, ABORT ─▶ SUCCEEDED, ABORTED

A goal that is being cancelled may still succeed or abort: the server decides. UNKNOWN is the state
of a goal that a server does not have. A rejected goal has no state.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType


class GoalState(IntEnum):
    """The state of a goal; the numbers are those of `action_msgs/msg/GoalStatus`."""

    UNKNOWN = 0
    """The server has no goal of this id: it never accepted it, or no longer keeps its result."""
    ACCEPTED = 1
    """The server has accepted the goal and not begun it."""
    EXECUTING = 2
    """The server executes the goal."""
    CANCELING = 3
    """The server has accepted a cancellation, and the goal has not ended."""
    SUCCEEDED = 4
    """The server completed the goal."""
    CANCELED = 5
    """The goal ended because a client, or the server at its end, cancelled it."""
    ABORTED = 6
    """The server ended the goal without completing it."""

    def __str__(self) -> str:
        return self.name

    @property
    def is_active(self) -> bool:
        """Whether a goal in this state has not ended."""
        return self in ACTIVE

    @property
    def is_ended(self) -> bool:
        """Whether a goal in this state has ended; no event changes it again."""
        return self in ENDED

    @property
    def is_cancelable(self) -> bool:
        """Whether a cancellation changes a goal in this state."""
        return (self, GoalEvent.CANCEL_GOAL) in TRANSITIONS


class GoalEvent(IntEnum):
    """What changes the state of a goal; the numbers are those of ROS's `GoalEvent`."""

    EXECUTE = 0
    """The server begins the goal."""
    CANCEL_GOAL = 1
    """The server accepts a client's cancellation."""
    SUCCEED = 2
    """The server has completed the goal."""
    ABORT = 3
    """The server gives the goal up."""
    CANCELED = 4
    """The server has stopped the goal after a cancellation."""

    def __str__(self) -> str:
        return self.name


ACTIVE = frozenset({GoalState.ACCEPTED, GoalState.EXECUTING, GoalState.CANCELING})
"""The states of a goal that has not ended."""

ENDED = frozenset({GoalState.SUCCEEDED, GoalState.CANCELED, GoalState.ABORTED})
"""The states in which a goal stays."""

TRANSITIONS: Mapping[tuple[GoalState, GoalEvent], GoalState] = MappingProxyType(
    {
        (GoalState.ACCEPTED, GoalEvent.EXECUTE): GoalState.EXECUTING,
        (GoalState.ACCEPTED, GoalEvent.CANCEL_GOAL): GoalState.CANCELING,
        (GoalState.EXECUTING, GoalEvent.CANCEL_GOAL): GoalState.CANCELING,
        (GoalState.EXECUTING, GoalEvent.SUCCEED): GoalState.SUCCEEDED,
        (GoalState.EXECUTING, GoalEvent.ABORT): GoalState.ABORTED,
        (GoalState.CANCELING, GoalEvent.SUCCEED): GoalState.SUCCEEDED,
        (GoalState.CANCELING, GoalEvent.ABORT): GoalState.ABORTED,
        (GoalState.CANCELING, GoalEvent.CANCELED): GoalState.CANCELED,
    }
)
"""The state after each event. A pair that is not here is not allowed."""


class InvalidTransition(ValueError):
    """A goal got an event that its state does not allow.

    Attributes:
        state: the state of the goal, which has not changed.
        event: the event.
    """

    def __init__(self, state: GoalState, event: GoalEvent) -> None:
        self.state, self.event = state, event
        allowed = [each.name for each in GoalEvent if (state, each) in TRANSITIONS]
        expected = f"expected {' or '.join(allowed)}" if allowed else "expected no more events"
        super().__init__(f"the goal is {state.name}: {expected}, got {event.name}")

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.state, self.event)


def next_state(state: GoalState, event: GoalEvent) -> GoalState:
    """Return the state of a goal after an event. Raises InvalidTransition."""
    following = TRANSITIONS.get((state, event))
    if following is None:
        raise InvalidTransition(state, event)
    return following
