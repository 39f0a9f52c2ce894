"""The interface between the task server and a robot: the methods of your own hardware class.

Write a class with these names (no base class is needed), and start the server with
``taskrpc-server --robot your_module:YourRobot``. The server executes one task at a time. It calls
`Robot.plan` when a client submits a task, to compute ``estimated_time``, and `Robot.execute` when
the task is the first in the queue.

There are two clocks. *Robot seconds* pass for the robot; *real seconds* pass for the client.
`Robot.speed` robot seconds pass in one real second. It is 1.0 for hardware; only a simulation can
be faster.

The methods of `RobotTelemetry` are optional: the live page shows what they return. A method
``reset()`` is optional too: ``taskrpc classroom reset`` calls it while the robot is idle, to put it
to its start.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec

from taskrpc.errors import TaskRpcError


class Pose(msgspec.Struct, frozen=True):
    """The robot's position and heading."""

    x: float
    """Metres to the right of the map's lower left corner."""
    y: float
    """Metres above the map's lower left corner."""
    theta: float
    """Radians counterclockwise from the x axis, in (-pi, pi]."""


class Plan(msgspec.Struct, frozen=True):
    """The plan of a task, if it started now and ran without interruption."""

    seconds: float
    """Robot seconds from the task's start to its end."""
    end: Pose
    """The pose after the task; the next task's plan starts here."""


class TargetError(TaskRpcError, ValueError):
    """The robot cannot use the target; the text says what is allowed instead."""


class RobotStopped(TaskRpcError):
    """`Robot.stop` ended this `Robot.execute` before its task was complete."""


class Robot(Protocol):
    """A robot that executes one task at a time, in the event loop's thread.

    Only `execute` may wait, and only with ``await``; every other method returns at once. Call a
    blocking driver (a serial port, a vendor's library) through ``asyncio.to_thread``.
    """

    @property
    def speed(self) -> float:
        """Robot seconds in one real second; 1.0 for hardware. A plain attribute is enough."""

    @property
    def task_types(self) -> Sequence[str]:
        """The task types that this robot can execute, such as ``("move", "scan", "report")``."""

    def plan(self, task_type: str, target: str, start: Pose) -> Plan:
        """Return how long the task takes from `start` and where it ends, without moving.

        The server calls it at each submit, so it must be fast. The same arguments must give the
        same plan. `task_type` is one of `task_types`; `target` is the text that the user typed.

        Raises:
            TargetError: the target is unknown, out of reach, or not a target at all.
        """

    def pose(self) -> Pose:
        """Return the robot's current pose, also while it moves."""

    async def execute(
        self, task_type: str, target: str, report: Callable[[float], None]
    ) -> dict[str, object]:
        """Execute one task from beginning to end and return its result, as JSON values.

        Call `report` with the progress (0.0 to 1.0, never falling) a few times a second. The
        server never starts a second `execute` before the first has ended. When the asyncio task
        is cancelled, halt the robot where it is and re-raise the ``CancelledError``; `pose` must
        be correct afterwards. Any other exception makes the task FAILED, with its text as the
        reason.

        Raises:
            TargetError: as `plan` does.
            RobotStopped: `stop` was called during the task.
        """

    def remaining(self) -> float:
        """Return the robot seconds until the running `execute` ends; 0.0 when idle.

        While paused: the seconds that `resume` will leave.
        """

    def pause(self) -> None:
        """Halt; an `execute` that runs or starts now waits for `resume`.

        A second `pause` does nothing. The end of the `execute` (a cancel, a stop) ends the pause.
        """

    def resume(self) -> None:
        """Continue after `pause`; without a pause, do nothing."""

    def stop(self) -> None:
        """Halt at once and drop the motion: a running `execute` ends with `RobotStopped`.

        The robot stays usable; the next `execute` starts from its current pose.
        """


class RobotTelemetry(Protocol):
    """Optional methods of a robot for the live page; a class may have any of them.

    The server calls them up to ten times a second while a live page is open, so they must be fast.
    """

    def planned_path(self) -> Sequence[tuple[float, float]]:
        """Return the points (x, y) of the current drive in metres, its start first."""

    def battery(self) -> float:
        """Return the battery's charge in percent."""

    def odometer(self) -> float:
        """Return the metres driven since the start."""
