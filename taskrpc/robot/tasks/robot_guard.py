"""The guard around a robot class: the robot may fail, the task queue must not.

Every call of the robot's methods goes through here, except `Robot.execute`, which a
`TaskExecution` awaits.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

from taskrpc.robot.protocol import Plan, Pose, Robot, TargetError
from taskrpc.robot.tasks.model import Task

_log = logging.getLogger("taskrpc.tasks")


_Value = TypeVar("_Value")

_MOST_POINTS = 1000  # of a planned path


class Telemetry(msgspec.Struct, frozen=True):
    """What a robot reports about itself, besides its task."""

    pose: Pose
    path: tuple[tuple[float, float], ...] = ()
    """The points (x, y) of the current drive in metres; empty if the robot reports none."""
    battery: float | None = None
    """Percent; None if the robot does not report it."""
    odometer: float | None = None
    """Metres since the start; None if the robot does not report it."""


class RobotGuard:
    """Calls a robot's methods; logs what they raise and returns a usable value instead.

    Args:
        robot: any object that follows the `Robot` protocol.

    Raises:
        ValueError: its speed is not a positive number.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        """The robot itself."""
        self.speed = float(robot.speed)
        """Robot seconds in a real second."""
        if not 0.0 < self.speed < math.inf:
            raise ValueError(f"expected a robot with a positive speed, got {robot.speed!r}")
        self._last_pose = Pose(0.0, 0.0, 0.0)
        self._pose_problem = ""  # the last logged one, so that it is logged once
        self._broken: set[str] = set()  # the optional methods that have failed; not called again

    def plan(self, task: Task, start: Pose) -> Plan:
        """Return the plan of an accepted task; 0 seconds at `start` if the robot fails."""
        try:
            return checked_plan(self.robot, task.task_type, task.target, start)
        except Exception as error:
            text = "task %d: the robot cannot plan it: %s"
            _log.warning(text, task.task_id, error_text(error), extra={"task": task.task_id})
            return Plan(0.0, start)

    def refusal(self, task_type: str, target: str) -> str:
        """Return why the robot cannot execute a task from its present pose, "" if it can."""
        try:
            checked_plan(self.robot, task_type, target, self.pose())
        except TargetError as error:
            return f"Invalid target: {error_text(error)[:400]}"
        except Exception as error:
            return f"The robot cannot plan this task: {error_text(error)[:400]}"
        return ""

    def pose(self) -> Pose:
        """Return the robot's pose; the last known one if the robot fails."""
        try:
            self._last_pose = self.robot.pose()
            self._pose_problem = ""
        except Exception as error:
            problem = error_text(error)
            if problem != self._pose_problem:  # the pose is read ten times a second
                self._pose_problem = problem
                _log.warning("the robot's pose is unknown: %s", problem)
        return self._last_pose

    def remaining(self, otherwise: float) -> float:
        """Return the robot seconds that the execution still takes, `otherwise` if it fails."""
        try:
            seconds = float(self.robot.remaining())
        except Exception as error:
            _log.warning("the robot's remaining time is unknown: %s", error_text(error))
            return otherwise
        return max(0.0, seconds) if math.isfinite(seconds) else otherwise

    def telemetry(self) -> Telemetry:
        """Return the robot's pose and what its optional methods report."""
        path = self._optional(
            "planned_path", lambda points: [(float(x), float(y)) for x, y in points]
        )
        battery, odometer = self._optional("battery", float), self._optional("odometer", float)
        return Telemetry(self.pose(), tuple(path or ())[:_MOST_POINTS], battery, odometer)

    def _optional(self, name: str, converted: Callable[[Any], _Value]) -> _Value | None:
        """Return the result of an optional method, None if the robot has none or it fails."""
        method = getattr(self.robot, name, None)
        if method is None or name in self._broken:
            return None
        try:
            return converted(method())
        except Exception as error:
            self._broken.add(name)
            _log.warning(
                "the robot's %s() failed, it is not called again: %s", name, error_text(error)
            )
            return None

    def command(self, command: Callable[[], None]) -> str:
        """Call a command of the robot; returns why it failed, "" if it did not."""
        try:
            command()
        except Exception as error:
            _log.exception("the robot failed")
            return f"the robot failed: {error_text(error)}"
        return ""


def checked_plan(robot: Robot, task_type: str, target: str, start: Pose) -> Plan:
    """Return the robot's plan.

    Raises:
        ValueError: the plan's seconds are not a finite number of 0 or more.
        Exception: whatever the robot's `plan` raises.
    """
    plan = robot.plan(task_type, target, start)
    if not 0.0 <= plan.seconds < math.inf:
        raise ValueError(f"expected a plan of 0 or more seconds, got {plan.seconds!r}")
    return plan


def error_text(error: BaseException) -> str:
    """Return an error as one line of valid Unicode that can be shown, stored and sent."""
    text = " ".join(str(error).split()) or "no reason given"
    text = text.encode(errors="replace").decode()
    name = type(error).__name__
    return text if name in ("TargetError", "RobotStopped") else f"{name}: {text}"
