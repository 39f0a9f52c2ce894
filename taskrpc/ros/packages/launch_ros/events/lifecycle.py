"""Events of lifecycle nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch.event import Event

VALID_TRANSITIONS = {
    0: "TRANSITION_CREATE",
    1: "TRANSITION_CONFIGURE",
    2: "TRANSITION_CLEANUP",
    3: "TRANSITION_ACTIVATE",
    4: "TRANSITION_DEACTIVATE",
    5: "TRANSITION_UNCONFIGURED_SHUTDOWN",
    6: "TRANSITION_INACTIVE_SHUTDOWN",
    7: "TRANSITION_ACTIVE_SHUTDOWN",
    8: "TRANSITION_DESTROY",
}
"""The transitions that a program may request: those of `lifecycle_msgs.msg.Transition`."""


class ChangeState(Event):
    """A request to change the state of lifecycle nodes.

    Args:
        lifecycle_node_matcher: returns whether an action's node is meant.
        transition_id: a constant of `lifecycle_msgs.msg.Transition`.
    """

    name = "launch_ros.events.lifecycle.ChangeState"
    valid_transitions = VALID_TRANSITIONS

    def __init__(
        self, *, lifecycle_node_matcher: Callable[[Any], bool], transition_id: int
    ) -> None:
        if not callable(lifecycle_node_matcher):
            raise TypeError(
                "ChangeState: lifecycle_node_matcher: expected a function such as"
                f" matches_action(node), got {lifecycle_node_matcher!r}"
            )
        if transition_id not in VALID_TRANSITIONS:
            raise ValueError(
                "ChangeState: transition_id: expected a constant of lifecycle_msgs.msg.Transition,"
                f" 0 to {max(VALID_TRANSITIONS)}, got {transition_id!r}"
            )
        self._matcher = lifecycle_node_matcher
        self._transition_id = transition_id

    @property
    def lifecycle_node_matcher(self) -> Callable[[Any], bool]:
        """Returns whether an action's node is meant."""
        return self._matcher

    @property
    def transition_id(self) -> int:
        """The transition."""
        return self._transition_id


class StateTransition(Event):
    """A lifecycle node has changed its state.

    Args:
        action: the action that started the node.
        msg: the `lifecycle_msgs.msg.TransitionEvent` that the node published.
    """

    name = "launch_ros.events.lifecycle.StateTransition"

    def __init__(self, *, action: Any, msg: Any) -> None:
        self._action = action
        self._msg = msg

    @property
    def action(self) -> Any:
        """The action that started the node."""
        return self._action

    @property
    def msg(self) -> Any:
        """The message."""
        return self._msg

    @property
    def timestamp(self) -> int:
        """When it happened, in nanoseconds; 0 if the node does not say."""
        return int(self._msg.timestamp)

    @property
    def transition(self) -> str:
        """The label of the transition, such as `configure`."""
        return str(self._msg.transition.label)

    @property
    def start_state(self) -> str:
        """The label of the state before, such as `unconfigured`."""
        return str(self._msg.start_state.label)

    @property
    def goal_state(self) -> str:
        """The label of the state now, such as `configuring`."""
        return str(self._msg.goal_state.label)


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    """Choose the node with a full name."""
    wanted = node_name if node_name.startswith("/") else f"/{node_name}"
    return lambda action: bool(action.node_name == wanted)
