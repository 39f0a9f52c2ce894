"""A robot class written by others, held at arm's length: it may fail, the queue may not."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

from taskrpc.robot.protocol import Plan, Pose, Robot
from taskrpc.tasks.model import Task

_log = logging.getLogger("taskrpc.tasks")


class RobotGuard:
    """Asks a robot what the task server wants to know and survives every answer.

    Args:
        robot: any object that follows the `Robot` protocol.

    Raises:
        ValueError: its speed is not a positive number.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.speed = float(robot.speed)
        if not 0.0 < self.speed < math.inf:
            raise ValueError(f"expected a robot with a positive speed, got {robot.speed!r}")
        self._last_pose = Pose(0.0, 0.0, 0.0)
        self._pose_problem = ""

    def plan(self, task: Task, start: Pose) -> Plan:
        """Plan an accepted task; a robot that cannot say takes no time and stays where it is."""
        try:
            return checked_plan(self.robot, task.task_type, task.target, start)
        except Exception as error:
            number, why = task.task_id, sentence(error)
            text = "task %d: the robot cannot plan it: %s"
            _log.warning(text, number, why, extra={"task": number})
            return Plan(0.0, start)

    def pose(self) -> Pose:
        """Where the robot is, or was when it last said."""
        try:
            self._last_pose = self.robot.pose()
            self._pose_problem = ""
        except Exception as error:
            problem = sentence(error)
            if problem != self._pose_problem:  # it is asked ten times a second
                self._pose_problem = problem
                _log.warning("the robot does not say where it is: %s", problem)
        return self._last_pose

    def remaining(self, otherwise: float) -> float:
        """Robot seconds until the running task ends, or a guess where the robot has no idea."""
        try:
            seconds = float(self.robot.remaining())
        except Exception as error:
            _log.warning("the robot does not say how long it takes: %s", sentence(error))
            return otherwise
        return max(0.0, seconds) if math.isfinite(seconds) else otherwise

    def order(self, order: Callable[[], None]) -> str:
        """Give the robot an order and return why it did not obey, empty if it did."""
        try:
            order()
        except Exception as error:
            _log.exception("the robot failed")
            return f"the robot failed: {sentence(error)}"
        return ""


def checked_plan(robot: Robot, task_type: str, target: str, start: Pose) -> Plan:
    """Ask the robot for a plan; raises what it raises, and ValueError if the plan is none."""
    plan = robot.plan(task_type, target, start)
    if not 0.0 <= plan.seconds < math.inf:
        raise ValueError(f"expected a plan of 0 or more seconds, got {plan.seconds!r}")
    return plan


def sentence(error: BaseException) -> str:
    """What went wrong, in one line that can be shown, stored and sent."""
    text = " ".join(str(error).split()) or "no reason given"
    text = text.encode(errors="replace").decode()
    name = type(error).__name__
    return text if name in ("TargetError", "RobotStopped") else f"{name}: {text}"
