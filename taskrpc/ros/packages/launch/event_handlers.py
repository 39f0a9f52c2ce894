"""Event handlers: react when a program starts, writes or ends."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from taskrpc.ros.module_names import add_module_names

from .event import Event
from .event_handler import BaseEventHandler
from .events.general import ExecutionComplete, IncludeLaunchDescription, Shutdown
from .events.process import ProcessExited, ProcessIO, ProcessStarted
from .launch_context import LaunchContext
from .launch_description_entity import LaunchDescriptionEntity, entities_of

# A target is an action, a function that chooses actions, or None for every action.


class OnActionEventBase(BaseEventHandler):
    """Handles the events of one kind, of one action or of all.

    Args:
        action_matcher: an action, a function that returns whether an action is meant, or None.
        on_event: entities to execute, or a function `(event, context)` that returns them.
        target_event_cls: the kind of events.
        target_action_cls: the kind of actions; actions of other kinds are never meant.
    """

    def __init__(
        self,
        *,
        action_matcher: Any,
        on_event: Any,
        target_event_cls: type[Event],
        target_action_cls: type | None = None,
        handle_once: bool = False,
        **_: Any,
    ) -> None:
        if action_matcher is not None and not callable(action_matcher):
            _check_target(type(self).__name__, action_matcher)
        self._target = action_matcher
        self._event_kind = target_event_cls
        self._on_event = on_event if callable(on_event) else entities_of(on_event)
        super().__init__(matcher=self._wants, handle_once=handle_once)

    def _wants(self, event: Any) -> bool:
        if not isinstance(event, self._event_kind):
            return False
        if self._target is None:
            return True
        action = event.action  # type: ignore[attr-defined]  # events of actions have one
        if callable(self._target) and not isinstance(self._target, LaunchDescriptionEntity):
            return bool(self._target(action))
        return action is self._target

    @property
    def matcher_description(self) -> str:
        """A description of the events that the handler selects."""
        target = "any action" if self._target is None else self._target
        return f"event == {self._event_kind.__name__} and event.action == {target}"

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        """Describe the handler, and list its entities if they are known."""
        known = [] if callable(self._on_event) else self._on_event
        return super().describe()[0], known

    def handle(self, event: Event, context: LaunchContext) -> Any:
        """Return the entities to execute."""
        super().handle(event, context)
        return _called(self._on_event, event, context)


def _check_target(name: str, target: Any) -> None:
    if not isinstance(target, LaunchDescriptionEntity):
        raise TypeError(
            f"{name} requires a 'target_action' argument which is an action or a callable,"
            f" got {target!r}"
        )


def _called(action: Any, event: Event, context: LaunchContext) -> Any:
    """The entities of a handler: given ones, or those that its function returns."""
    if not callable(action):
        return action
    # Programs write functions of the event alone, too.
    try:
        count = len(inspect.signature(action).parameters)
    except (TypeError, ValueError):
        count = 2
    return action(event, context) if count != 1 else action(event)


class OnProcessStart(OnActionEventBase):
    """Handles the start of a program."""

    def __init__(self, *, target_action: Any = None, on_start: Any, **kwargs: Any) -> None:
        super().__init__(
            action_matcher=target_action,
            on_event=on_start,
            target_event_cls=ProcessStarted,
            **kwargs,
        )


class OnProcessExit(OnActionEventBase):
    """Handles the end of a program."""

    def __init__(self, *, target_action: Any = None, on_exit: Any = None, **kwargs: Any) -> None:
        super().__init__(
            action_matcher=target_action,
            on_event=on_exit,
            target_event_cls=ProcessExited,
            **kwargs,
        )


class OnExecutionComplete(OnActionEventBase):
    """Handles the end of an action's work."""

    def __init__(
        self, *, target_action: Any = None, on_completion: Any = None, **kwargs: Any
    ) -> None:
        super().__init__(
            action_matcher=target_action,
            on_event=on_completion,
            target_event_cls=ExecutionComplete,
            **kwargs,
        )


class OnProcessIO(OnActionEventBase):
    """Handles what a program writes; each function gets the event."""

    def __init__(
        self,
        *,
        target_action: Any = None,
        on_stdin: Callable[[Any], Any] | None = None,
        on_stdout: Callable[[Any], Any] | None = None,
        on_stderr: Callable[[Any], Any] | None = None,
        **kwargs: Any,
    ) -> None:
        handlers = (on_stdin, on_stdout, on_stderr)

        def on_event(event: Any, context: LaunchContext) -> Any:
            is_from = (event.from_stdin, event.from_stdout, event.from_stderr)
            handler = handlers[is_from.index(True)]
            return None if handler is None else _called(handler, event, context)

        super().__init__(
            action_matcher=target_action, on_event=on_event, target_event_cls=ProcessIO, **kwargs
        )


class OnShutdown(BaseEventHandler):
    """Handles the shutdown of the launch."""

    def __init__(self, *, on_shutdown: Any, **kwargs: Any) -> None:
        super().__init__(matcher=lambda event: isinstance(event, Shutdown), **kwargs)
        self._on_shutdown = on_shutdown if callable(on_shutdown) else entities_of(on_shutdown)

    @property
    def matcher_description(self) -> str:
        """A description of the events that the handler selects."""
        return "event issubclass of launch.events.Shutdown"

    def describe(self) -> tuple[str, list[LaunchDescriptionEntity]]:
        """Describe the handler, and list its entities if they are known."""
        return super().describe()[0], [] if callable(self._on_shutdown) else self._on_shutdown

    def handle(self, event: Event, context: LaunchContext) -> Any:
        """Return the entities to execute."""
        super().handle(event, context)
        return _called(self._on_shutdown, event, context)


class OnIncludeLaunchDescription(BaseEventHandler):
    """Executes launch descriptions that a program adds."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(
            matcher=lambda event: isinstance(event, IncludeLaunchDescription), **kwargs
        )

    def handle(self, event: Any, context: LaunchContext) -> Any:
        """Return the launch description."""
        super().handle(event, context)
        return event.launch_description


__all__ = [
    "OnActionEventBase",
    "OnExecutionComplete",
    "OnIncludeLaunchDescription",
    "OnProcessExit",
    "OnProcessIO",
    "OnProcessStart",
    "OnShutdown",
]

add_module_names(__name__)
