"""Events of lifecycle nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch.event import Event


class ChangeState(Event):
    """A request to change the state of lifecycle nodes; taskrpc's launch does not act on it."""

    name = "launch_ros.events.lifecycle.ChangeState"

    def __init__(
        self, *, lifecycle_node_matcher: Callable[[Any], bool], transition_id: int
    ) -> None:
        self.lifecycle_node_matcher = lifecycle_node_matcher
        self.transition_id = transition_id


class StateTransition(Event):
    """A change of state; taskrpc's launch does not emit it."""

    name = "launch_ros.events.lifecycle.StateTransition"


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    """Choose the node with a full name."""
    wanted = node_name if node_name.startswith("/") else f"/{node_name}"
    return lambda action: bool(action.node_name == wanted)
