"""Event handlers of ROS in launch files."""

from __future__ import annotations

from typing import Any

from launch.event_handler import EventHandler

from .events.lifecycle import StateTransition


class OnStateTransition(EventHandler):
    """Handles changes of a lifecycle node's state, which taskrpc's launch does not emit."""

    def __init__(
        self,
        *,
        entities: Any = None,
        target_lifecycle_node: Any = None,
        transition: str | None = None,
        start_state: str | None = None,
        goal_state: str | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(
            matcher=lambda event: isinstance(event, StateTransition), entities=entities, **kwargs
        )
