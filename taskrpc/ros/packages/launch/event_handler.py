"""The base classes of event handlers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .event import Event
from .launch_context import LaunchContext
from .launch_description_entity import LaunchDescriptionEntity, entities_of


class BaseEventHandler:
    """Selects events, and decides which entities the launch executes for them.

    Args:
        matcher: returns whether the handler wants an event.
        handle_once: unregister the handler after its first event.
    """

    def __init__(self, *, matcher: Callable[[Event], bool], handle_once: bool = False) -> None:
        self._matcher = matcher
        self._handle_once = handle_once

    @property
    def handle_once(self) -> bool:
        """Whether the handler handles only one event."""
        return self._handle_once

    @property
    def handler_description(self) -> str:
        """A description of the handler's work."""
        return type(self).__name__

    @property
    def matcher_description(self) -> str:
        """A description of the events that the handler selects."""
        return repr(self._matcher)

    def matches(self, event: Event) -> bool:
        """Return whether the handler selects an event."""
        return bool(self._matcher(event))

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        """Describe the handler, and list the entities that it may execute."""
        return f"{type(self).__name__}(matcher='{self.matcher_description}')", []

    def handle(self, event: Event, context: LaunchContext) -> Any:
        """Return the entities to execute for an event."""
        context.extend_locals({"event": event})
        if self._handle_once:
            context.unregister_event_handler(self)
        return None


class EventHandler(BaseEventHandler):
    """Executes the same entities for each event that it selects."""

    def __init__(
        self,
        *,
        matcher: Callable[[Event], bool],
        entities: Any = None,
        handle_once: bool = False,
    ) -> None:
        super().__init__(matcher=matcher, handle_once=handle_once)
        self._entities = entities_of(entities)

    @property
    def entities(self) -> list[LaunchDescriptionEntity]:
        """The entities that are executed."""
        return self._entities

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        """Describe the handler, and list its entities."""
        return super().describe()[0], self._entities

    def handle(self, event: Event, context: LaunchContext) -> Any:
        """Return the entities."""
        super().handle(event, context)
        return self._entities
