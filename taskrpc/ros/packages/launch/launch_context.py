"""The state of a launch: configurations, environment, local values, event queue and handlers.

The context decides nothing and waits for nothing; `LaunchService` takes the events out of it.
"""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping, MutableMapping
from typing import Any, Protocol

from .event import Event


class Handler(Protocol):
    """What the context keeps of an event handler."""

    def matches(self, event: Event) -> bool:
        """Return whether the handler wants the event."""

    def handle(self, event: Event, context: LaunchContext) -> Any:
        """Return the entities to execute for the event."""


class _Performable(Protocol):
    def perform(self, context: LaunchContext) -> str:
        """Compute the text."""


class Locals:
    """The local values as attributes, such as `context.locals.event`."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = values

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name not in self._values:
            raise AttributeError(f"context.locals does not contain attribute '{name}'")
        return self._values[name]


class LaunchContext:
    """The state of one launch, which actions and substitutions read and change."""

    def __init__(self, *, argv: Iterable[str] | None = None, noninteractive: bool = False) -> None:
        self._argv = list(argv or ())
        self._noninteractive = noninteractive
        self._configurations: dict[str, Any] = {}
        self._stacked_configurations: list[dict[str, Any]] = []
        self._stacked_environments: list[dict[str, str]] = []
        self._environment_at_start = dict(os.environ)
        self._locals: dict[str, Any] = {}
        self._stacked_locals: list[dict[str, Any]] = []
        self._handlers: deque[Handler] = deque()
        self._is_shutdown = False
        self.events: deque[Event] = deque()
        """The events that are not processed yet, oldest first."""
        self.on_event: Callable[[], object] = lambda: None
        """Called after each new event; the service sets it."""
        self.used_configurations: set[str] = set()
        """The names of all configurations that were declared or read so far."""
        self.global_values: dict[str, Any] = {}
        """Values of extensions for the whole launch, such as ROS's global parameters."""
        self.asyncio_loop: asyncio.AbstractEventLoop | None = None
        """The event loop while the service runs."""
        self.at_end: list[Callable[[], Any]] = []
        """Coroutine functions that the service awaits after the shutdown."""

    @property
    def argv(self) -> list[str]:
        """The arguments of the launch service."""
        return self._argv

    @property
    def noninteractive(self) -> bool:
        """Whether the launch is not started from a terminal."""
        return self._noninteractive

    @property
    def is_shutdown(self) -> bool:
        """Whether the launch is shutting down."""
        return self._is_shutdown

    def set_is_shutdown(self) -> None:
        """Remember that the launch is shutting down."""
        self._is_shutdown = True

    # Launch configurations

    @property
    def launch_configurations(self) -> dict[str, Any]:
        """The values of launch arguments and other configurations, by name."""
        return self._configurations

    def push_launch_configurations(self) -> None:
        """Begin a scope of configurations."""
        self._stacked_configurations.append(dict(self._configurations))

    def pop_launch_configurations(self) -> None:
        """End a scope of configurations and restore the earlier values."""
        if not self._stacked_configurations:
            raise RuntimeError("cannot pop launch configurations: none were pushed")
        # In place: substitutions and programs keep references to this dict.
        values = self._stacked_configurations.pop()
        self._configurations.clear()
        self._configurations.update(values)

    # Environment

    @property
    def environment(self) -> MutableMapping[str, str]:
        """The environment variables of this process, which the started programs get too."""
        return os.environ

    def push_environment(self) -> None:
        """Begin a scope of environment variables."""
        self._stacked_environments.append(dict(os.environ))

    def pop_environment(self) -> None:
        """End a scope of environment variables and restore the earlier values."""
        if not self._stacked_environments:
            raise RuntimeError("cannot pop environment variables: none were pushed")
        replace_environment(self._stacked_environments.pop())

    def reset_environment(self) -> None:
        """Restore the variables that this process had when the launch began."""
        replace_environment(self._environment_at_start)

    # Local values

    @property
    def locals(self) -> Locals:
        """The local values: of the event, and of the launch file."""
        return Locals(self._locals)

    def get_locals_as_dict(self) -> dict[str, Any]:
        """The local values by name."""
        return self._locals

    def extend_locals(self, values: Mapping[str, Any]) -> None:
        """Add local values."""
        self._locals.update(values)

    def push_locals(self) -> None:
        """Begin a scope of local values."""
        self._stacked_locals.append(dict(self._locals))

    def pop_locals(self) -> None:
        """End a scope of local values."""
        self._locals = self._stacked_locals.pop()

    # Events

    def emit_event_sync(self, event: Event) -> None:
        """Add an event to the queue."""
        self.events.append(event)
        self.on_event()

    async def emit_event(self, event: Event) -> None:
        """As `emit_event_sync`."""
        self.emit_event_sync(event)

    @property
    def handlers(self) -> tuple[Handler, ...]:
        """The registered event handlers, newest first."""
        return tuple(self._handlers)

    def register_event_handler(self, event_handler: Handler, append: bool = False) -> None:
        """Register a handler before all others, or after them with `append`."""
        if append:
            self._handlers.append(event_handler)
        else:
            self._handlers.appendleft(event_handler)

    def unregister_event_handler(self, event_handler: Handler) -> None:
        """Remove a handler; raises ValueError if it is not registered."""
        self._handlers.remove(event_handler)

    def perform_substitution(self, substitution: _Performable) -> str:
        """Compute the text of one substitution."""
        return substitution.perform(self)


def replace_environment(values: Mapping[str, str]) -> None:
    """Set this process's environment variables to exactly these."""
    for name in set(os.environ) - set(values):
        del os.environ[name]
    os.environ.update(values)
