"""Actions that decide what happens and when: groups, functions, timers, events, log lines."""

from __future__ import annotations

import asyncio
import inspect
import logging
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from taskrpc.spi import yaml_text

from ..action import Action
from ..event import Event
from ..event_handler import BaseEventHandler
from ..events.general import Shutdown as ShutdownEvent
from ..events.general import TimerEvent
from ..events.process import ProcessExited
from ..launch_context import LaunchContext
from ..launch_description_entity import (
    LaunchDescriptionEntity,
    checked_entities,
    entities_of,
)
from ..logging import get_logger
from ..some_substitutions_type import SomeSubstitutionsType
from ..substitution import (
    Substitution,
    normalize_to_list_of_substitutions,
    perform,
    perform_substitutions,
)
from .arguments import (
    PopEnvironment,
    PopLaunchConfigurations,
    PushEnvironment,
    PushLaunchConfigurations,
    ResetEnvironment,
    ResetLaunchConfigurations,
    SetLaunchConfiguration,
)


class GroupAction(Action):
    """Executes several actions.

    Args:
        scoped: changes of configurations and variables end with the group.
        forwarding: the group sees the configurations and variables from outside.
        launch_configurations: configurations to set in the group.
    """

    def __init__(
        self,
        actions: Iterable[Any],
        *,
        scoped: bool = True,
        forwarding: bool = True,
        launch_configurations: Mapping[Any, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._actions = checked_entities(actions, "GroupAction()")
        self._scoped = scoped
        self._forwarding = forwarding
        self._configurations = dict(launch_configurations or {})

    def get_sub_entities(self) -> list[Any]:
        """The actions, with those that begin and end the scope."""
        values = [SetLaunchConfiguration(*each) for each in self._configurations.items()]
        if not self._scoped:
            return [*values, *self._actions]
        begin: list[Any] = [PushLaunchConfigurations(), PushEnvironment()]
        if self._forwarding:
            begin += values
        else:
            begin += [ResetEnvironment(), ResetLaunchConfigurations(self._configurations)]
        return [*begin, *self._actions, PopEnvironment(), PopLaunchConfigurations()]

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Return the actions."""
        return self.get_sub_entities()


class OpaqueFunction(Action):
    """Calls a function of the launch file, `function(context, *args, **kwargs)`.

    The function may return entities, which are executed next.
    """

    def __init__(
        self,
        *,
        function: Callable[..., Any],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        **left_over_kwargs: Any,
    ) -> None:
        super().__init__(**left_over_kwargs)
        if not callable(function):
            raise TypeError(
                f"OpaqueFunction expected a callable for 'function', got '{type(function)}'"
            )
        self._function = function
        self._args = tuple(args or ())
        self._kwargs = dict(kwargs or {})

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Call the function."""
        return entities_of(self._function(context, *self._args, **self._kwargs))


class OpaqueCoroutine(Action):
    """Runs a coroutine function of the launch file while the launch continues."""

    def __init__(
        self,
        *,
        coroutine: Callable[..., Any],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        ignore_context: bool = False,
        **left_over_kwargs: Any,
    ) -> None:
        super().__init__(**left_over_kwargs)
        if not inspect.iscoroutinefunction(coroutine):
            raise TypeError(
                f"OpaqueCoroutine expected a coroutine function for 'coroutine', got '{coroutine}'"
            )
        self._coroutine = coroutine
        self._args = tuple(args or ())
        self._kwargs = dict(kwargs or {})
        self._ignore_context = ignore_context
        self._future: asyncio.Future[None] | None = None

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Start the coroutine; a shutdown cancels it."""
        first = () if self._ignore_context else (context,)
        self._future = future = asyncio.ensure_future(
            self._coroutine(*first, *self._args, **self._kwargs)
        )
        _at_shutdown(context, future.cancel)
        return None

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """A future that is done with the coroutine."""
        return self._future


def _at_shutdown(context: LaunchContext, function: Callable[[], object]) -> None:
    def handle(event: Event) -> bool:
        if isinstance(event, ShutdownEvent):
            function()
        return False

    context.register_event_handler(BaseEventHandler(matcher=handle))


class TimerAction(Action):
    """Executes entities after a time in seconds."""

    def __init__(
        self,
        *,
        period: float | SomeSubstitutionsType,
        actions: Iterable[Any],
        cancel_on_shutdown: Any = True,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._period = normalize_to_list_of_substitutions(
            str(period) if isinstance(period, (int, float)) else period
        )
        self._actions = checked_entities(actions, "TimerAction()")
        self._cancel_on_shutdown = cancel_on_shutdown
        self._future: asyncio.Future[None] | None = None
        self._is_cancelled = False

    @property
    def period(self) -> list[Substitution]:
        """The time in seconds."""
        return self._period

    @property
    def actions(self) -> list[LaunchDescriptionEntity]:
        """The entities that are executed."""
        return self._actions

    def describe_conditional_sub_entities(self) -> list[tuple[str, list[LaunchDescriptionEntity]]]:
        """The entities, with the time."""
        period = " + ".join(each.describe() for each in self._period)
        return [(f"after {period} seconds", self._actions)]

    def cancel(self) -> None:
        """Stop waiting; the entities are not executed."""
        self._is_cancelled = True
        if self._future is not None:
            self._future.cancel()

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Begin to wait."""
        if self._is_cancelled or context.is_shutdown:
            return None
        seconds = float(perform_substitutions(context, self._period))
        values = dict(context.get_locals_as_dict())
        self._future = asyncio.ensure_future(self._wait(context, seconds))
        actions = self._actions

        class Handler(BaseEventHandler):
            def handle(self, event: Event, context: LaunchContext) -> Any:
                super().handle(event, context)
                context.extend_locals(values)
                return actions

        context.register_event_handler(
            Handler(matcher=lambda event: _is_of(event, self), handle_once=True)
        )
        if self._cancel_on_shutdown:
            _at_shutdown(context, self.cancel)
        return None

    async def _wait(self, context: LaunchContext, seconds: float) -> None:
        await asyncio.sleep(seconds)
        context.emit_event_sync(TimerEvent(timer_action=self))

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """A future that is done when the time is over."""
        return self._future


def _is_of(event: Event, action: Action) -> bool:
    return isinstance(event, TimerEvent) and event.timer_action is action


class RegisterEventHandler(Action):
    """Registers an event handler."""

    def __init__(self, event_handler: BaseEventHandler, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if not isinstance(event_handler, BaseEventHandler):
            raise TypeError(f"RegisterEventHandler() expected a handler, got {event_handler!r}")
        self._handler = event_handler

    @property
    def event_handler(self) -> BaseEventHandler:
        """The handler."""
        return self._handler

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Register the handler."""
        context.register_event_handler(self._handler)
        return None

    def describe_conditional_sub_entities(self) -> list[tuple[str, list[LaunchDescriptionEntity]]]:
        """The entities that the handler may execute."""
        description, entities = self._handler.describe()
        return [(description, entities)] if entities else []


class UnregisterEventHandler(Action):
    """Removes an event handler."""

    def __init__(self, event_handler: BaseEventHandler, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._handler = event_handler

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Remove the handler."""
        context.unregister_event_handler(self._handler)
        return None


class EmitEvent(Action):
    """Emits an event."""

    def __init__(self, *, event: Event, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if not isinstance(event, Event):
            raise RuntimeError(f"EmitEvent() expected an event, got '{event}'")
        self._event = event

    @property
    def event(self) -> Event:
        """The event."""
        return self._event

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Emit the event."""
        context.emit_event_sync(self._event)
        return None


class Shutdown(EmitEvent):
    """Ends the launch: all programs end."""

    def __init__(self, *, reason: str = "reason not given", **kwargs: Any) -> None:
        super().__init__(event=ShutdownEvent(reason=reason), **kwargs)

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Emit the event; if the end of a program caused it, the reason names this program."""
        event = context.get_locals_as_dict().get("event")
        if isinstance(event, ProcessExited) and not context.is_shutdown:
            get_logger("launch").info(
                f"process[{event.process_name}] was required: shutting down launched system"
            )
        return super().execute(context)


class Log(Action):
    """Writes a log line of this level, such as `WARNING`."""

    def __init__(
        self, *, msg: SomeSubstitutionsType, level: SomeSubstitutionsType = "INFO", **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self._msg = normalize_to_list_of_substitutions(msg)
        self._level = normalize_to_list_of_substitutions(level)

    @property
    def msg(self) -> list[Substitution]:
        """The text."""
        return self._msg

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Write the line."""
        level = perform_substitutions(context, self._level).upper()
        number = logging.getLevelNamesMapping().get(level)
        if number is None:
            raise KeyError(f"Invalid log level '{level}'")
        get_logger("launch.user").log(number, "%s", perform_substitutions(context, self._msg))
        return None


class LogInfo(Log):
    """Writes a log line of the level INFO."""

    def __init__(self, *, msg: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(msg=msg, level="INFO", **kwargs)


class LogDebug(Log):
    """Writes a log line of the level DEBUG."""

    def __init__(self, *, msg: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(msg=msg, level="DEBUG", **kwargs)


class LogWarning(Log):
    """Writes a log line of the level WARNING."""

    def __init__(self, *, msg: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(msg=msg, level="WARNING", **kwargs)


class LogError(Log):
    """Writes a log line of the level ERROR."""

    def __init__(self, *, msg: SomeSubstitutionsType, **kwargs: Any) -> None:
        super().__init__(msg=msg, level="ERROR", **kwargs)


class ForEach(Action):
    """Calls a function with the values of each part of a text, `{name: a};{name: b}`."""

    def __init__(
        self, input_values: SomeSubstitutionsType, *, function: Callable[..., Any], **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self._values = input_values
        self._function = function

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Call the function for each part."""
        found: list[Any] = []
        for part in perform(context, self._values).split(";"):
            values = yaml_text.load(part)
            if isinstance(values, dict):
                found += entities_of(self._function(**values))
        return found


class ForLoop(Action):
    """Calls a function with 0, 1, 2 and so on; a text gives the number of calls."""

    def __init__(
        self, length: SomeSubstitutionsType, *, function: Callable[[int], Any], **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self._length = length
        self._function = function

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Call the function."""
        length = self._length
        count = length if isinstance(length, int) else int(perform(context, length))
        return [each for number in range(count) for each in entities_of(self._function(number))]
