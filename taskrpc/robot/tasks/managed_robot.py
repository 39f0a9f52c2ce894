"""A manager's own robot: what the managers of one robot and of a fleet have in common."""

from __future__ import annotations

from typing import Protocol

from taskrpc.errors import TaskRpcError
from taskrpc.robot.protocol import Pose, Robot
from taskrpc.robot.tasks import rules
from taskrpc.robot.tasks.managed import TaskRecords
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.responses import TaskResponse, by_client, unstored_note
from taskrpc.robot.tasks.robot_guard import RobotGuard, Telemetry
from taskrpc.robot.tasks.task_execution import TaskExecution


class RobotWorker(Protocol):
    """What lets the robot execute one task after another."""

    @property
    def execution(self) -> TaskExecution | None:
        """The execution of the running task; None while the robot is idle."""

    async def cancel(self, execution: TaskExecution, message: str, client: str) -> bool:
        """Cancel the running task; returns whether it has ended already."""


class ManagedRobot:
    """The robot that a manager drives, and the task that this robot executes.

    Args:
        robot: an object that follows the `Robot` protocol.
    """

    repository: TaskRecords
    _worker: RobotWorker

    def __init__(self, robot: Robot) -> None:
        self._robot_guard = RobotGuard(robot)
        self.is_closed = False
        """Whether `close` has been called; afterwards, no other method may be called."""

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
        execution = self._worker.execution
        return self.repository.find(execution.task.task_id) if execution else None

    def remaining(self) -> float:
        """Return the robot seconds until the running task ends; 0.0 while the robot is idle."""
        execution = self._worker.execution
        return execution.remaining() if execution else 0.0

    def pose(self) -> Pose:
        """Return the robot's pose, or its last known one."""
        return self._robot_guard.pose()

    def telemetry(self) -> Telemetry:
        """Return the robot's pose and, if it reports them, its path, battery and odometer."""
        return self._robot_guard.telemetry()

    def _running(self, task_id: int) -> TaskExecution | None:
        """Return the execution of a task, None if this robot does not execute it now."""
        execution = self._worker.execution
        return execution if execution and execution.task.task_id == task_id else None

    async def _cancel_running(self, task_id: int, client: str) -> TaskResponse | None:
        """Halt the robot if it executes a task, before anything else is stored.

        Returns the response, None if the robot does not execute this task.
        """
        if (execution := self._running(task_id)) is None:
            return None
        try:
            reason = by_client("cancelled", client)
            is_over = await self._worker.cancel(execution, reason, client)
        except TaskRpcError as error:  # the robot halts although this could not be stored
            message = f"Task {task_id} is being cancelled{unstored_note(error)}"
            return TaskResponse(True, message, task_id)
        # In a fleet, another server may have ended the task in another way.
        return rules.halted(self.repository.find(task_id) or execution.task, is_over=is_over)
