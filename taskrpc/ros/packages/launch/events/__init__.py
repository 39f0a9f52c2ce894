"""Events: things that have happened, and requests from parts of the launch.

Events of processes are in `launch.events.process`. The handlers of events are in
`launch.event_handlers`; `launch.actions.EmitEvent` emits an event.
"""

from .general import ExecutionComplete, IncludeLaunchDescription, Shutdown, TimerEvent
from .process import matches_action

__all__ = [
    "ExecutionComplete",
    "IncludeLaunchDescription",
    "Shutdown",
    "TimerEvent",
    "matches_action",
]
