"""The states of a lifecycle node, and which step leads from one to another."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

from ..exceptions import RCLError


class TransitionCallbackReturnType(enum.Enum):
    """What the callback of a step says of it; programs know it as `TransitionCallbackReturn`."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """The name of the step that this leads to."""
        return f"transition_{self.name.lower()}"

    def __int__(self) -> int:
        return self.value


class State(NamedTuple):
    """One state, as services number and name it."""

    id: int
    label: str


class LifecycleState(NamedTuple):
    """A state as callbacks of programs receive it."""

    label: str
    state_id: int


class Transition(NamedTuple):
    """One step."""

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
    """The steps by which a callback's state is left."""
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
    """Where a node stands, and where it can go from there.

    Arguments:
        changed: is told of each step that asks for it.
        refused: is told, in a sentence, of a step that is not possible now.
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
        """All states that there are."""
        return list(STATES)

    @property
    def available_transitions(self) -> list[Transition]:
        """The steps that are possible now."""
        return [one for one in TRANSITIONS if one.start is self._state]

    @property
    def transition_graph(self) -> list[Transition]:
        """All steps that there are."""
        return list(TRANSITIONS)

    def get_transition_by_label(self, label: str) -> int:
        """The number of a step that is possible now; raises RCLError where there is none."""
        for transition in self.available_transitions:
            if transition.label == label:
                return transition.id
        raise RCLError(f"Failed to get transition from label '{label}'")

    def trigger_transition_by_id(self, transition_id: int, publish_update: bool) -> None:
        """Take a step. Raises RCLError where it is not possible now."""
        self._trigger(transition_id, lambda one: one.id == transition_id, publish_update)

    def trigger_transition_by_label(self, label: str, publish_update: bool) -> None:
        """Take a step by its name. Raises RCLError where it is not possible now."""
        self._trigger(label, lambda one: one.label == label, publish_update)

    def _trigger(self, what: object, fits: Callable[[Transition], bool], told: bool) -> None:
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
        if told:
            self._changed(transition)
