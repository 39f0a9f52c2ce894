"""Actions that start lifecycle nodes and change their states."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from launch.action import Action
from launch.event import Event
from launch.event_handler import BaseEventHandler
from launch.logging import get_logger
from launch.substitution import normalize_to_list_of_substitutions, perform_substitutions

from ..events.lifecycle import ChangeState, StateTransition, matches_node_name
from .node import Node

_CONFIGURE, _ACTIVATE = 1, 3
_GOALS = {
    _CONFIGURE: ("configuring", "inactive"),
    2: ("cleaningup", "unconfigured"),
    _ACTIVATE: ("activating", "active"),
    4: ("deactivating", "inactive"),
    5: ("shuttingdown", "finalized"),
    6: ("shuttingdown", "finalized"),
    7: ("shuttingdown", "finalized"),
}
"""By transition: the states before and after its last step."""
_FAILED = "errorprocessing"


class LifecycleNode(Node):
    """Starts a lifecycle node, and changes its state on request: see `ChangeState`.

    Each change of its state is a `StateTransition` event.

    Args:
        name: the node's name, which is required.
        autostart: configure and activate the node as soon as it runs.
    """

    def __init__(self, *, autostart: Any = False, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if kwargs.get("name") is None and kwargs.get("node_name") is None:
            raise RuntimeError("LifecycleNode: 'name' must not be None")
        self._autostart = autostart

    @property
    def node_autostart(self) -> Any:
        """Whether the launch configures and activates the node."""
        return self._autostart

    def execute(self, context: Any) -> list[Any] | None:
        """Start the node."""
        from ..lifecycle_control import LifecycleControl  # few launch files need a node of ROS

        found: list[Any] = super().execute(context) or []
        if self.process_details is None:  # it is not here
            return found
        control = LifecycleControl(self, context)
        context.register_event_handler(control)
        context.at_end.insert(0, control.close)
        if self._autostart:
            transitions = [_CONFIGURE, _ACTIVATE]
            found.append(
                LifecycleTransition(
                    lifecycle_node_names=[self.node_name], transition_ids=transitions
                )
            )
        return found


class LifecycleTransition(Action):
    """Changes the states of lifecycle nodes: one transition after the other.

    Args:
        lifecycle_node_names: the full names of the nodes.
        transition_ids: constants of `lifecycle_msgs.msg.Transition`, in their order.
    """

    def __init__(
        self, *, lifecycle_node_names: Iterable[Any], transition_ids: Iterable[Any], **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self._names = [normalize_to_list_of_substitutions(each) for each in lifecycle_node_names]
        self._ids = [
            normalize_to_list_of_substitutions(str(each) if isinstance(each, int) else each)
            for each in transition_ids
        ]
        if not self._names:
            raise ValueError("No lifecycle_node_names provided.")
        if not self._ids:
            raise ValueError("No transition_ids provided.")

    def execute(self, context: Any) -> list[Any] | None:
        """Request the first transition of each node."""
        texts = [perform_substitutions(context, each) for each in self._ids]
        for text in texts:
            if not text.isdigit() or int(text) not in _GOALS:
                known = ", ".join(map(str, _GOALS))
                raise ValueError(
                    f"expected integer for lifecycle transition, one of {known}, got {text}"
                )
        for each in self._names:
            name = perform_substitutions(context, each)
            context.register_event_handler(_Sequence(name, [int(text) for text in texts], context))
        return None


class _Sequence(BaseEventHandler):
    """Requests the next transition of a node when the one before has ended."""

    def __init__(self, name: str, transitions: list[int], context: Any) -> None:
        super().__init__(matcher=self._wants)
        self._name = name
        self._is_meant = matches_node_name(name)
        self._left = transitions
        self._request(context)

    def _request(self, context: Any) -> None:
        event = ChangeState(lifecycle_node_matcher=self._is_meant, transition_id=self._left[0])
        context.emit_event_sync(event)

    def _wants(self, event: Event) -> bool:
        if not isinstance(event, StateTransition) or not self._is_meant(event.action):
            return False
        states = (event.start_state, event.goal_state)
        return states == _GOALS[self._left[0]] or event.goal_state == _FAILED

    def handle(self, event: Any, context: Any) -> None:
        """Request the next transition, or end after the last one and after an error."""
        super().handle(event, context)
        if event.goal_state == _FAILED:
            get_logger("launch_ros.actions.lifecycle_transition").info(
                f"Stopping transitions for {self._name} because 'error occurred during transitions'"
            )
            self._left.clear()
        else:
            del self._left[0]
        if self._left:
            self._request(context)
        else:
            context.unregister_event_handler(self)
