"""The seam between the task server and a robot: what your own hardware class must offer.

Write a class with these names (no base class is needed), and start the server with
``taskrpc-server --robot your_module:YourRobot``. The server runs one task at a time: it asks
`Robot.plan` when a task is submitted, to answer ``estimated_time``, and `Robot.execute` when the
task's turn has come.

Two clocks occur here. *Robot seconds* are what the robot lives through; *real seconds* are what
the caller's clock shows. `Robot.speed` robot seconds pass in one real second; it is 1.0 for
hardware, and only a simulation can be hurried.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec

from taskrpc.errors import TaskRpcError


class Pose(msgspec.Struct, frozen=True):
    """Where the robot stands and which way it looks."""

    x: float
    """Metres to the right of the map's lower left corner."""
    y: float
    """Metres above the map's lower left corner."""
    theta: float
    """Radians counterclockwise from the x axis, in (-pi, pi]."""


class Plan(msgspec.Struct, frozen=True):
    """What a task would take, if it started now and nobody interfered."""

    seconds: float
    """Robot seconds from the task's start to its end."""
    end: Pose
    """Where the robot stands afterwards; the next task's plan starts here."""


class TargetError(TaskRpcError, ValueError):
    """The target makes no sense for this robot; the text tells the user what is allowed instead."""


class RobotStopped(TaskRpcError):
    """`Robot.stop` ended this task's `Robot.execute` before it was done."""


class Robot(Protocol):
    """A robot that does one task at a time, each in the event loop's thread.

    Only `execute` may wait, and only by ``await``; every other method answers at once. A driver
    that must block (a serial port, a vendor's library) belongs in ``asyncio.to_thread``.
    """

    @property
    def speed(self) -> float:
        """Robot seconds that pass in one real second; 1.0 for hardware. An attribute will do."""

    @property
    def task_types(self) -> Sequence[str]:
        """The task types that this robot understands, such as ``("move", "scan", "report")``."""

    def plan(self, task_type: str, target: str, start: Pose) -> Plan:
        """Say how long the task takes from `start` and where it ends, without moving.

        It is asked at each submit, so it must be cheap; the same question gets the same answer.
        `task_type` is one of `task_types`, `target` is as the user typed it.

        Raises:
            TargetError: the target is unknown, out of reach, or not a target at all.
        """

    def pose(self) -> Pose:
        """Say where the robot is now, in motion too."""

    async def execute(
        self, task_type: str, target: str, report: Callable[[float], None]
    ) -> dict[str, object]:
        """Do one task from its beginning to its end and return its result, as JSON values.

        Call `report` with the progress (0.0 to 1.0, never falling) a few times a second. The
        server never starts a second `execute` before the first has ended. When the asyncio task
        is cancelled, halt the robot where it is and let the ``CancelledError`` through; `pose`
        must be right afterwards. Any other exception makes the task FAILED, with its text as the
        reason.

        Raises:
            TargetError: as `plan` does.
            RobotStopped: `stop` was called meanwhile.
        """

    def remaining(self) -> float:
        """Robot seconds until the running `execute` ends; 0.0 when idle.

        While paused: what will be left at the moment of `resume`.
        """

    def pause(self) -> None:
        """Halt; the running `execute` waits for `resume`, and one that starts meanwhile too.

        A second `pause` does nothing. The end of the `execute` (a cancel, a stop) ends the pause.
        """

    def resume(self) -> None:
        """Go on after `pause`; without one, do nothing."""

    def stop(self) -> None:
        """Halt at once and forget the motion: an `execute` that runs ends with `RobotStopped`.

        The robot stays usable; the next `execute` starts from where it stands.
        """
