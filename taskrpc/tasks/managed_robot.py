"""A manager's own robot: what the managers of one robot and of a fleet have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from taskrpc.robot.protocol import Pose, Robot
from taskrpc.tasks.managed import TaskRecords
from taskrpc.tasks.model import Task
from taskrpc.tasks.robot_guard import RobotGuard, Telemetry

if TYPE_CHECKING:
    from taskrpc.tasks.task_execution import TaskExecution


class ManagedRobot(ABC):
    """The robot that a manager drives, and the task that this robot executes.

    Args:
        robot: an object that follows the `Robot` protocol.
    """

    repository: TaskRecords

    def __init__(self, robot: Robot) -> None:
        self._robot_guard = RobotGuard(robot)
        self.is_closed = False
        """Whether `close` has been called; afterwards, no other method may be called."""

    @property
    @abstractmethod
    def _execution(self) -> TaskExecution | None:
        """The execution of the running task, None while the robot is idle."""

    @property
    def robot(self) -> Robot:
        """This server's robot; call its methods through the manager."""
        return self._robot_guard.robot

    @property
    def speed(self) -> float:
        """Robot seconds in a real second."""
        return self._robot_guard.speed

    @property
    def running(self) -> Task | None:
        """The task that this server's robot executes, None if it is idle."""
        execution = self._execution
        return self.repository.find(execution.task.task_id) if execution else None

    def remaining(self) -> float:
        """Return the robot seconds until the running task ends; 0.0 while the robot is idle."""
        execution = self._execution
        return execution.remaining() if execution else 0.0

    def pose(self) -> Pose:
        """Return the robot's pose, or its last known one."""
        return self._robot_guard.pose()

    def telemetry(self) -> Telemetry:
        """Return the robot's pose and, if it reports them, its path, battery and odometer."""
        return self._robot_guard.telemetry()

    def _running(self, task_id: int) -> TaskExecution | None:
        """Return the execution of a task, None if this robot does not execute it now."""
        execution = self._execution
        return execution if execution and execution.task.task_id == task_id else None
