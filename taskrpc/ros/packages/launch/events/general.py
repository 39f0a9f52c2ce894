"""Events of the launch itself."""

from __future__ import annotations

from typing import Any

from ..event import Event


class Shutdown(Event):
    """The launch shuts down."""

    name = "launch.events.Shutdown"

    def __init__(
        self, *, reason: str = "reason not given", due_to_sigint: bool = False, **_: Any
    ) -> None:
        self._reason = reason
        self._due_to_sigint = due_to_sigint

    @property
    def reason(self) -> str:
        """Why the launch shuts down."""
        return self._reason

    @property
    def due_to_sigint(self) -> bool:
        """Whether Ctrl-C was the reason."""
        return self._due_to_sigint


class IncludeLaunchDescription(Event):
    """A request to execute a launch description."""

    name = "launch.events.IncludeLaunchDescription"

    def __init__(self, launch_description: Any) -> None:
        self._launch_description = launch_description

    @property
    def launch_description(self) -> Any:
        """The launch description."""
        return self._launch_description


class TimerEvent(Event):
    """The waiting time of a `TimerAction` has passed."""

    name = "launch.events.TimerEvent"

    def __init__(self, *, timer_action: Any) -> None:
        self._timer_action = timer_action

    @property
    def timer_action(self) -> Any:
        """The action whose waiting time has passed."""
        return self._timer_action


class ExecutionComplete(Event):
    """An action has done all its work."""

    name = "launch.events.ExecutionComplete"

    def __init__(self, *, action: Any) -> None:
        self._action = action

    @property
    def action(self) -> Any:
        """The action."""
        return self._action
