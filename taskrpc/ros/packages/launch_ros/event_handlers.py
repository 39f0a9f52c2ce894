"""Event handlers of ROS in launch files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch.event import Event
from launch.event_handler import EventHandler

from .events.lifecycle import StateTransition


class OnStateTransition(EventHandler):
    """Handles changes of the states of lifecycle nodes.

    Args:
        target_lifecycle_node: the action that started the node; None for all nodes.
        transition, start_state, goal_state: only changes with this label; None for all.
        matcher: a function that selects events, instead of these arguments.
    """

    def __init__(
        self,
        *,
        entities: Any = None,
        target_lifecycle_node: Any = None,
        transition: str | None = None,
        start_state: str | None = None,
        goal_state: str | None = None,
        matcher: Callable[[Any], bool] | None = None,
        **kwargs: Any,
    ) -> None:
        self._target = target_lifecycle_node
        labels = {"transition": transition, "start_state": start_state, "goal_state": goal_state}
        self._labels = {name: label for name, label in labels.items() if label is not None}
        super().__init__(matcher=matcher or self._wants, entities=entities, **kwargs)

    def _wants(self, event: Event) -> bool:
        return (
            isinstance(event, StateTransition)
            and self._target in (None, event.action)
            and all(getattr(event, name) == label for name, label in self._labels.items())
        )
