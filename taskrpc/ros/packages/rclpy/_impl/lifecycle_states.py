"""The states of a lifecycle node and the table of its transitions."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

from ..exceptions import RCLError


class TransitionCallbackReturnType(enum.Enum):
    """The result of a transition callback; programs know it as `TransitionCallbackReturn`."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """The label of the transition that follows."""
        return f"transition_{self.name.lower()}"

    def __int__(self) -> int:
        return self.value


class State(NamedTuple):
    """A state with its number and label."""

    id: int
    label: str


class LifecycleState(NamedTuple):
    """A state as callbacks of programs receive it."""

    label: str
    state_id: int


class Transition(NamedTuple):
    """A transition between two states."""

    id: int
    label: str
    start: State
    goal: State


UNKNOWN = State(0, "unknown")
UNCONFIGURED = State(1, "unconfigured")
INACTIVE = State(2, "inactive")
ACTIVE = State(3, "active")
FINALIZED = State(4, "finalized")
CONFIGURING = State(10, "configuring")
CLEANING_UP = State(11, "cleaningup")
SHUTTING_DOWN = State(12, "shuttingdown")
ACTIVATING = State(13, "activating")
DEACTIVATING = State(14, "deactivating")
ERROR_PROCESSING = State(15, "errorprocessing")

STATES = (
    UNKNOWN,
    UNCONFIGURED,
    INACTIVE,
    ACTIVE,
    FINALIZED,
    CONFIGURING,
    CLEANING_UP,
    SHUTTING_DOWN,
    ACTIVATING,
    DEACTIVATING,
    ERROR_PROCESSING,
)


def _ends(
    first_id: int, at: State, success: State, failure: State, error: State
) -> list[Transition]:
    """The transitions out of the state of a callback, one for each result."""
    goals = zip(TransitionCallbackReturnType, (success, failure, error), strict=True)
    return [
        Transition(first_id + number, what.to_label(), at, goal)
        for number, (what, goal) in enumerate(goals)
    ]


TRANSITIONS = (
    Transition(1, "configure", UNCONFIGURED, CONFIGURING),
    *_ends(10, CONFIGURING, INACTIVE, UNCONFIGURED, ERROR_PROCESSING),
    Transition(2, "cleanup", INACTIVE, CLEANING_UP),
    *_ends(20, CLEANING_UP, UNCONFIGURED, INACTIVE, ERROR_PROCESSING),
    Transition(3, "activate", INACTIVE, ACTIVATING),
    *_ends(30, ACTIVATING, ACTIVE, INACTIVE, ERROR_PROCESSING),
    Transition(4, "deactivate", ACTIVE, DEACTIVATING),
    *_ends(40, DEACTIVATING, INACTIVE, ACTIVE, ERROR_PROCESSING),
    Transition(5, "shutdown", UNCONFIGURED, SHUTTING_DOWN),
    Transition(6, "shutdown", INACTIVE, SHUTTING_DOWN),
    Transition(7, "shutdown", ACTIVE, SHUTTING_DOWN),
    *_ends(50, SHUTTING_DOWN, FINALIZED, FINALIZED, ERROR_PROCESSING),
    *_ends(60, ERROR_PROCESSING, UNCONFIGURED, FINALIZED, FINALIZED),
)


class LifecycleStateMachine:
    """The current state of a node, and the transitions that are possible.

    Arguments:
        changed: receives each transition that must be published.
        refused: receives a sentence about each transition that is not possible now.
    """

    def __init__(
        self, changed: Callable[[Transition], object], refused: Callable[[str], object]
    ) -> None:
        self._state = UNCONFIGURED
        self._changed = changed
        self._refused = refused

    @property
    def initialized(self) -> bool:
        """Whether it can be used; always."""
        return True

    @property
    def current_state(self) -> State:
        """The number and the name of the state."""
        return self._state

    @property
    def available_states(self) -> list[State]:
        """All states."""
        return list(STATES)

    @property
    def available_transitions(self) -> list[Transition]:
        """The transitions that are possible now."""
        return [one for one in TRANSITIONS if one.start is self._state]

    @property
    def transition_graph(self) -> list[Transition]:
        """All transitions."""
        return list(TRANSITIONS)

    def get_transition_by_label(self, label: str) -> int:
        """The number of a transition that is possible now; raises RCLError without one."""
        for transition in self.available_transitions:
            if transition.label == label:
                return transition.id
        raise RCLError(f"Failed to get transition from label '{label}'")

    def trigger_transition_by_id(self, transition_id: int, publish_update: bool) -> None:
        """Make a transition. Raises RCLError if it is not possible now."""
        self._trigger(transition_id, lambda one: one.id == transition_id, publish_update)

    def trigger_transition_by_label(self, label: str, publish_update: bool) -> None:
        """Make a transition by its label. Raises RCLError if it is not possible now."""
        self._trigger(label, lambda one: one.label == label, publish_update)

    def _trigger(self, what: object, fits: Callable[[Transition], bool], publish: bool) -> None:
        transition = next(filter(fits, self.available_transitions), None)
        if transition is None:
            self._refused(
                f"No transition matching {what} found for current state {self._state.label}"
            )
            raise RCLError(
                "Failed to trigger lifecycle state machine transition:"
                " Transition is not registered."
            )
        self._state = transition.goal
        if publish:
            self._changed(transition)
