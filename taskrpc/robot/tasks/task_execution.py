"""The execution of one task, from the stored RUNNING to the stored end."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable
from typing import Protocol

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.protocol import RobotStopped
from taskrpc.robot.tasks.model import (
    BEGUN,
    ClientDecision,
    EstimateChange,
    Task,
    TaskState,
)
from taskrpc.robot.tasks.robot_guard import RobotGuard, error_text

_log = logging.getLogger("taskrpc.tasks")


class ExecutionRecords(Protocol):
    """Where an execution stores and announces its task's changes."""

    def save(self, task: Task, /) -> Awaitable[None]:
        """Store and announce a change. Raises TaskRpcError."""

    def announce_progress(self, task_id: int, progress: float) -> None:
        """Announce a task's progress, which is not stored."""

    def announce_unstored(self, task: Task) -> None:
        """Announce a change that the store refused, where hiding it would be worse."""


class TaskExecution:
    """One execution: the worker calls `begin`, `wait` and `end`, in this order.

    Meanwhile the task manager may call the other methods.

    Args:
        robot_guard: the robot.
        repository: stores every change of state before it is announced.
        task: the task, QUEUED.
        planned: the robot seconds that the task is planned to take.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        robot_guard: RobotGuard,
        repository: ExecutionRecords,
        task: Task,
        planned: float,
        wall_clock: Callable[[], float],
    ) -> None:
        self.task = task
        """The task as it is now."""
        self.planned = planned
        self.is_over = asyncio.Event()
        """Set when the end is stored and announced."""
        self._robot_guard = robot_guard
        self._repository = repository
        self._wall_clock = wall_clock
        self._changing = asyncio.Lock()  # one change of state at a time
        # The state and message to end with after a halt; None while nothing halts the execution.
        self._ending: tuple[TaskState, str] | None = None
        self._decisions: list[ClientDecision] = []  # stored with the task's end
        self._outcome = (TaskState.INTERRUPTED, "", "")  # state, message, result
        self._robot_task: asyncio.Future[dict[str, object]] | None = None
        self._has_started = False  # whether the robot's own coroutine runs
        self._is_free = asyncio.Event()  # set when the robot is free again

    async def begin(self) -> None:
        """Store that the task runs, then start the robot.

        Raises:
            TaskRpcError: the state could not be stored; the robot did not move.
        """
        try:
            await self._change_state(
                lambda task: task.started(self._wall_clock()), TaskState.QUEUED
            )
        except TaskRpcError:
            self.is_over.set()
            raise
        if self._ending is not None:
            self._is_free.set()
            return
        _log.info(
            "Executing task %d: %s - %s",
            self.task.task_id,
            self.task.task_type,
            self.task.target,
            extra={"task": self.task.task_id},
        )
        self._robot_task = asyncio.ensure_future(self._execute())
        self._robot_task.add_done_callback(lambda _: self._is_free.set())

    async def _execute(self) -> dict[str, object]:
        """Run the robot's own code; whatever it raises makes the task FAILED."""
        robot = self._robot_guard.robot
        result = robot.execute(self.task.task_type, self.task.target, self._report)
        if not hasattr(result, "__await__"):
            raise TypeError("execute() must be `async def`")
        self._has_started = True
        return await result

    async def wait(self) -> TaskState:
        """Wait until the robot is free again; returns the state in which the task will end."""
        await self._is_free.wait()
        self._outcome = self._decide_outcome()
        return self._outcome[0]

    async def end(self, changes: tuple[EstimateChange, ...]) -> None:
        """Store the end and the estimate's changes; announced even if the store refuses."""
        try:
            await self._change_state(lambda task: self._ended(task, changes), *BEGUN)
        finally:
            task_id = self.task.task_id
            _log.info("Task %d %s", task_id, _ending_text(self.task), extra={"task": task_id})
            self.is_over.set()

    def remaining(self) -> float:
        """Return the robot seconds until the robot is free."""
        if self._is_free.is_set():
            return 0.0
        if not self._has_started:  # the robot does not know this task yet
            return self.planned
        return self._robot_guard.remaining(otherwise=self.planned)

    async def pause(self) -> str:
        """Halt the robot during the task; returns why the robot failed, "" if it did not."""
        if failure := self._robot_guard.command(self._robot_guard.robot.pause):
            return failure
        await self._change_state(lambda task: task.moved_to(TaskState.PAUSED), TaskState.RUNNING)
        return ""

    async def resume(self) -> str:
        """Let the robot continue; returns why the robot failed, "" if it did not."""
        if failure := self._robot_guard.command(self._robot_guard.robot.resume):
            return failure
        await self._change_state(lambda task: task.moved_to(TaskState.RUNNING), TaskState.PAUSED)
        return ""

    async def cancel(self, message: str, client: str | None = None) -> None:
        """Halt the robot; the task ends CANCELED, and `is_over` is set when it has.

        `client` has decided this; None if the decision is stored already.
        """
        self._decide("cancelled", client)
        self._halt(TaskState.CANCELED, message)
        await self._change_state(
            lambda task: task.moved_to(TaskState.CANCELING), TaskState.RUNNING, TaskState.PAUSED
        )

    def stop(self, message: str, client: str | None = None) -> str:
        """Halt the robot at once; the task ends CANCELED. Returns why the robot failed.

        `client` as for `cancel`.
        """
        self._decide("stopped", client)
        if self._ending is None:
            self._ending = (TaskState.CANCELED, message)
        failure = self._robot_guard.command(self._robot_guard.robot.stop)
        if failure:
            self._halt(TaskState.CANCELED, message)
        return failure

    def interrupt(self, message: str) -> None:
        """Halt the robot; the task ends INTERRUPTED."""
        self._halt(TaskState.INTERRUPTED, message)

    def abandon(self) -> None:
        """Stop waiting for a robot that does not end its task."""
        self._robot_guard.command(self._robot_guard.robot.stop)
        self._is_free.set()

    def _decide(self, action: str, client: str | None) -> None:
        if client is not None and self._ending is None:  # the first reason counts
            self._decisions.append(ClientDecision(self._wall_clock(), client, action))

    def _halt(self, state: TaskState, message: str) -> None:
        if self._ending is None:
            self._ending = (state, message)
        if self._robot_task is not None:
            self._robot_task.cancel()

    def _ended(self, task: Task, changes: tuple[EstimateChange, ...]) -> Task:
        state, message, result = self._outcome
        ended = task.ended(state, self._wall_clock(), message=message, result=result)
        return msgspec.structs.replace(ended, changes=changes).with_decisions(*self._decisions)

    async def _change_state(self, change: Callable[[Task], Task], *only_from: TaskState) -> None:
        """Store a change of state, unless the task has left the states that it starts from."""
        async with self._changing:
            if self.task.state not in only_from:
                return
            changed = change(self.task)
            try:
                await self._repository.save(changed)
            except TaskRpcError:
                if not changed.state.is_ended:
                    raise
                # The robot has ended the task, so hiding that would be worse. After a restart the
                # task is INTERRUPTED.
                self._repository.announce_unstored(changed)
                self.task = changed
                raise
            progress = max(changed.progress, self.task.progress)  # reported during the save
            self.task = msgspec.structs.replace(changed, progress=progress)

    def _report(self, progress: float) -> None:
        if self._is_free.is_set() or not math.isfinite(progress):
            return
        progress = min(1.0, max(progress, self.task.progress))
        if progress > self.task.progress:
            self.task = msgspec.structs.replace(self.task, progress=progress)
            self._repository.announce_progress(self.task.task_id, progress)

    def _decide_outcome(self) -> tuple[TaskState, str, str]:
        """Return the state in which the task ends, the message, and the result as JSON."""
        robot_task = self._robot_task
        if robot_task is not None and robot_task.done() and not robot_task.cancelled():
            error = robot_task.exception()
            if error is None:
                return _success(robot_task.result())
            if self._ending is None or not isinstance(error, RobotStopped):
                task_id = self.task.task_id
                _log.error("task %d failed", task_id, exc_info=error, extra={"task": task_id})
            if self._ending is None:
                return TaskState.FAILED, error_text(error), ""
        gave_no_reason = (TaskState.FAILED, "the robot ended the task without a reason")
        state, message = self._ending or gave_no_reason
        return state, message, ""


def _success(result: object) -> tuple[TaskState, str, str]:
    try:
        return TaskState.SUCCEEDED, "", msgspec.json.encode(result, enc_hook=repr).decode()
    except Exception as error:  # the robot has done the work: the task has not failed
        message = f"its result cannot be written as JSON: {error_text(error)}"
        return TaskState.SUCCEEDED, message, ""


def _ending_text(task: Task) -> str:
    if task.state is TaskState.SUCCEEDED:
        return "completed"
    return f"ended {task.state.value}" + (f": {task.message}" if task.message else "")
