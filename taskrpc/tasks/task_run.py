"""One task in the robot's hands, from the first stored RUNNING to the stored end."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.protocol import RobotStopped
from taskrpc.tasks.model import BEGUN, EstimateChange, State, Task
from taskrpc.tasks.records.repository import TaskBook
from taskrpc.tasks.robot_guard import RobotGuard, sentence

_log = logging.getLogger("taskrpc.tasks")


class Run:
    """The run of one task: `begin`, `wait`, `end`, in this order, by the worker.

    Meanwhile others may `pause`, `resume` and `halt` it.

    Args:
        guard: the robot.
        book: where every change of state is stored before it is announced.
        task: the task, QUEUED.
        planned: robot seconds that it is planned to take.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        guard: RobotGuard,
        book: TaskBook,
        task: Task,
        planned: float,
        wall_clock: Callable[[], float],
    ) -> None:
        self.task = task
        self.planned = planned
        self.is_over = asyncio.Event()
        """Set when the end is stored and announced."""
        self._guard = guard
        self._book = book
        self._wall_clock = wall_clock
        self._moving = asyncio.Lock()  # one change of state at a time
        self._verdict: tuple[State, str] | None = None  # how it ends if it is halted
        self._outcome = (State.INTERRUPTED, "", "")  # state, message, result
        self._execution: asyncio.Future[dict[str, object]] | None = None
        self._is_driving = False
        self._is_free = asyncio.Event()

    async def begin(self) -> None:
        """Store that it runs, then let the robot go.

        Raises:
            TaskRpcError: it could not be stored; the robot did not move.
        """
        try:
            await self._move(lambda task: task.started(self._wall_clock()), State.QUEUED)
        except TaskRpcError:
            self.is_over.set()
            raise
        if self._verdict is not None:
            self._is_free.set()
            return
        _log.info(
            "Executing task %d: %s - %s",
            self.task.task_id,
            self.task.task_type,
            self.task.target,
            extra={"task": self.task.task_id},
        )
        self._execution = asyncio.ensure_future(self._execute())
        self._execution.add_done_callback(lambda _: self._is_free.set())

    async def _execute(self) -> dict[str, object]:
        """Run the robot's own code where all that it raises is the task's failure."""
        robot = self._guard.robot
        result = robot.execute(self.task.task_type, self.task.target, self._report)
        if not hasattr(result, "__await__"):
            raise TypeError("execute() must be `async def`")
        self._is_driving = True
        return await result

    async def wait(self) -> State:
        """Wait until the robot is free again; returns the state in which the task will end."""
        await self._is_free.wait()
        self._outcome = self._judge()
        return self._outcome[0]

    async def end(self, changes: tuple[EstimateChange, ...]) -> None:
        """Store how it ended and with what estimate; announced even if the store refuses."""
        try:
            await self._move(lambda task: self._ended(task, changes), *BEGUN)
        finally:
            number = self.task.task_id
            _log.info("Task %d %s", number, _said(self.task), extra={"task": number})
            self.is_over.set()

    def remaining(self) -> float:
        """Robot seconds until the robot is free."""
        if self._is_free.is_set():
            return 0.0
        if not self._is_driving:  # the robot does not know of it yet
            return self.planned
        return self._guard.remaining(otherwise=self.planned)

    async def pause(self) -> str:
        """Halt the robot in mid-task; returns why it did not obey, else an empty text."""
        if failure := self._guard.order(self._guard.robot.pause):
            return failure
        await self._move(lambda task: task.moved_to(State.PAUSED), State.RUNNING)
        return ""

    async def resume(self) -> str:
        """Let the robot go on; returns why it did not obey, else an empty text."""
        if failure := self._guard.order(self._guard.robot.resume):
            return failure
        await self._move(lambda task: task.moved_to(State.RUNNING), State.PAUSED)
        return ""

    async def cancel(self, message: str) -> None:
        """Halt the robot and let the task end CANCELED; `is_over` tells when it has."""
        self._halt(State.CANCELED, message)
        await self._move(lambda task: task.moved_to(State.CANCELING), State.RUNNING, State.PAUSED)

    def stop(self, message: str) -> str:
        """Halt the robot at once and let the task end CANCELED; returns why it did not obey."""
        if self._verdict is None:
            self._verdict = (State.CANCELED, message)
        failure = self._guard.order(self._guard.robot.stop)
        if failure:
            self._halt(State.CANCELED, message)
        return failure

    def interrupt(self, message: str) -> None:
        """Halt the robot and let the task end INTERRUPTED."""
        self._halt(State.INTERRUPTED, message)

    def abandon(self) -> None:
        """Wait no longer for a robot that does not let go."""
        self._guard.order(self._guard.robot.stop)
        self._is_free.set()

    def _halt(self, state: State, message: str) -> None:
        if self._verdict is None:
            self._verdict = (state, message)
        if self._execution is not None:
            self._execution.cancel()

    def _ended(self, task: Task, changes: tuple[EstimateChange, ...]) -> Task:
        state, message, result = self._outcome
        ended = task.ended(state, self._wall_clock(), message=message, result=result)
        return msgspec.structs.replace(ended, changes=changes)

    async def _move(self, change: Callable[[Task], Task], *only_from: State) -> None:
        """Store a change of state, unless it comes too late."""
        async with self._moving:
            if self.task.state not in only_from:
                return
            moved = change(self.task)
            try:
                await self._book.save(moved)
            except TaskRpcError:
                if not moved.state.is_ended:
                    raise
                # The robot is done, whatever the disk says. After a restart it is INTERRUPTED.
                self._book.note_unstored(moved)
                self.task = moved
                raise
            progress = max(moved.progress, self.task.progress)  # it was reported meanwhile
            self.task = msgspec.structs.replace(moved, progress=progress)

    def _report(self, progress: float) -> None:
        if self._is_free.is_set() or not math.isfinite(progress):
            return
        progress = min(1.0, max(progress, self.task.progress))
        if progress > self.task.progress:
            self.task = msgspec.structs.replace(self.task, progress=progress)
            self._book.note_progress(self.task.task_id, progress)

    def _judge(self) -> tuple[State, str, str]:
        """The state in which it ended, why, and the robot's result as JSON."""
        execution = self._execution
        if execution is not None and execution.done() and not execution.cancelled():
            error = execution.exception()
            if error is None:
                return _success(execution.result())
            if self._verdict is None or not isinstance(error, RobotStopped):
                number = self.task.task_id
                _log.error("task %d failed", number, exc_info=error, extra={"task": number})
            if self._verdict is None:
                return State.FAILED, sentence(error), ""
        state, message = self._verdict or (State.FAILED, "the robot gave it up without a reason")
        return state, message, ""


def _success(result: object) -> tuple[State, str, str]:
    try:
        return State.SUCCEEDED, "", msgspec.json.encode(result, enc_hook=repr).decode()
    except Exception as error:  # the work is done, so it is no failure of the task
        return State.SUCCEEDED, f"its result cannot be written as JSON: {sentence(error)}", ""


def _said(task: Task) -> str:
    if task.state is State.SUCCEEDED:
        return "completed"
    return f"ended {task.state.value}" + (f": {task.message}" if task.message else "")
