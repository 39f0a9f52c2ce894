"""The worker: takes one task after another from the queue and lets the robot execute it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable

from taskrpc.errors import TaskRpcError
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.queue.estimated_queue import EstimatedQueue
from taskrpc.robot.tasks.records.repository import TaskRepository
from taskrpc.robot.tasks.responses import SERVER_ENDED
from taskrpc.robot.tasks.robot_guard import RobotGuard
from taskrpc.robot.tasks.task_execution import TaskExecution

_log = logging.getLogger("taskrpc.tasks")

_ENDINGS = {TaskState.CANCELED: "was cancelled", TaskState.FAILED: "failed"}
_HALT_TIMEOUT = 1.0  # real seconds that a robot may take to end a halted execution


class Worker:
    """Executes the queued tasks, one at a time, from `start` until `close`.

    Args:
        robot_guard: the robot.
        estimated_queue: the queued tasks.
        repository: stores every change before it is announced.
        settle: real seconds that an idle worker waits for more tasks before it takes one.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        robot_guard: RobotGuard,
        estimated_queue: EstimatedQueue,
        repository: TaskRepository,
        *,
        settle: float,
        wall_clock: Callable[[], float],
    ) -> None:
        self.execution: TaskExecution | None = None
        """The execution of the running task; None while the robot is idle."""
        self._robot_guard = robot_guard
        self._estimated_queue = estimated_queue
        self._repository = repository
        self._wall_clock = wall_clock
        self._settle_time = _Countdown(settle)
        # Two events, one the inverse of the other, because coroutines wait for both.
        self._resumed = asyncio.Event()
        self._resumed.set()
        self._paused = asyncio.Event()
        self._worker: asyncio.Task[None] | None = None

    @property
    def is_paused(self) -> bool:
        """Whether the worker takes no task until `resume`."""
        return not self._resumed.is_set()

    def start(self, *, paused: bool = False) -> None:
        """Start to take tasks; with `paused`, only after `resume`."""
        if paused:
            self._resumed.clear()
            self._paused.set()
        self._worker = asyncio.create_task(self._work(), name="taskrpc worker")

    async def close(self) -> None:
        """Halt the robot and end; the running task is stored as INTERRUPTED."""
        if self._worker is None:
            return
        self._pause_queue()
        if execution := self.execution:
            execution.interrupt(SERVER_ENDED)
            if not await self._ends_soon(execution):
                execution.abandon()
                await execution.is_over.wait()
        self._worker.cancel()
        await asyncio.wait({self._worker})

    def now(self) -> float:
        """Return the robot's clock, in robot seconds."""
        return asyncio.get_running_loop().time() * self._robot_guard.speed

    def update_estimates(self) -> None:
        """Bring the estimates up to date; call it before reading them."""
        if self.execution is None:
            self._estimated_queue.set_start_pose(self._robot_guard.pose(), "the robot was moved")
        self._set_free_at(self._drift_cause)

    async def pause(self) -> str:
        """Halt the robot and take no more tasks; returns why the robot failed, "" if not."""
        self._pause_queue()
        return await self.execution.pause() if self.execution else ""

    async def resume(self) -> str:
        """Undo `pause`; returns why the robot failed, "" if it did not."""
        if self.execution:
            failure = await self.execution.resume()
        else:
            failure = self._robot_guard.command(self._robot_guard.robot.resume)
        self.update_estimates()
        self._paused.clear()
        self._resumed.set()
        self._repository.change_feed.announce()
        return failure

    async def stop(self, message: str, client: str) -> str:
        """Halt the robot at once and pause the queue; returns why the robot failed, "" if not."""
        self._pause_queue()
        if (execution := self.execution) is None:
            return self._robot_guard.command(self._robot_guard.robot.stop)
        failure = execution.stop(message, client)
        has_ended = await self._ends_soon(execution)
        return failure or ("" if has_ended else "the robot does not end its task")

    async def cancel(self, execution: TaskExecution, message: str, client: str) -> bool:
        """Cancel the running task; returns whether it has ended already."""
        self.update_estimates()
        await execution.cancel(message, client)
        return await self._ends_soon(execution)

    async def _work(self) -> None:
        while True:
            task = await self._take()
            try:
                await self._execute(task)
            except TaskRpcError as error:
                _log.error("the queue is paused: %s", error)
                self._pause_queue()
            except Exception:
                _log.exception("the queue is paused: the task server itself failed")
                self._pause_queue()

    async def _take(self) -> Task:
        """Wait for the next task that may begin; the caller begins it without awaiting first."""
        queue = self._estimated_queue.queue
        while True:
            if not queue:
                self._settle_time.reset()
            task = await queue.get()
            obstacle = self._obstacle(task)
            if obstacle is None:
                return task
            queue.put_back(task)
            await obstacle

    def _obstacle(self, task: Task) -> Awaitable[object] | None:
        """Return what must end before the queue's first task may begin, None if nothing."""
        if self.is_paused:
            return self._resumed.wait()
        if self._settle_time.left(self._loop_time()) > 0:
            return self._settle()
        if not self._repository.is_settled(task.task_id):
            return self._until_stored(task)
        return None

    async def _settle(self) -> None:
        self._settle_time.start(self._loop_time())
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._settle_time.left(self._loop_time())):
                await self._paused.wait()
        self._settle_time.hold(self._loop_time())

    async def _until_stored(self, task: Task) -> None:
        stored = await self._repository.stored(task.task_id)
        if stored is None and task.task_id in self._estimated_queue.queue:
            self._estimated_queue.remove(task.task_id, "was never stored")

    async def _execute(self, task: Task) -> None:
        self.update_estimates()
        planned = self._estimated_queue.begin(task)
        self.execution = execution = TaskExecution(
            self._robot_guard, self._repository, task, planned, self._wall_clock
        )
        try:
            await execution.begin()
        except TaskRpcError:
            self.execution = None
            self._estimated_queue.undo_begin(task, self._robot_guard.pose(), planned)
            raise
        try:
            ending = _ENDINGS.get(await execution.wait())
            cause = f"task {task.task_id} {ending}" if ending else self._drift_cause()
            self._set_free_at(lambda: cause)
            changes = self._estimated_queue.end(self.now())
            self._estimated_queue.set_start_pose(self._robot_guard.pose(), cause)
            await execution.end(changes)
        finally:
            self.execution = None

    def _set_free_at(self, cause: Callable[[], str]) -> None:
        self._estimated_queue.set_free_at(self.now() + self._busy_seconds(), cause)

    def _busy_seconds(self) -> float:
        """Return the robot seconds until the first queued task can begin, without any pause."""
        if self.execution is not None:
            return self.execution.remaining()
        return self._settle_time.left(self._loop_time()) * self._robot_guard.speed

    def _drift_cause(self) -> str:
        """Return why the robot will be free at another time than the estimates assume."""
        if self.is_paused:
            return "the queue was paused"
        if self.execution is None:
            return "the task server was late"
        drift = self._estimated_queue.drift(self.now() + self._busy_seconds())
        how = "longer" if drift > 0 else "less time"
        return f"task {self.execution.task.task_id} took {how} than planned"

    def _pause_queue(self) -> None:
        if self.is_paused:
            return
        self.update_estimates()
        self._resumed.clear()
        self._paused.set()
        self._settle_time.hold(self._loop_time())
        self._repository.change_feed.announce()

    async def _ends_soon(self, execution: TaskExecution) -> bool:
        """Wait for the end of a halted execution; returns whether it ended in time."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_HALT_TIMEOUT):
                await execution.is_over.wait()
        return execution.is_over.is_set()

    @staticmethod
    def _loop_time() -> float:
        return asyncio.get_running_loop().time()


class _Countdown:
    """Seconds that run down only between `start` and `hold`."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._left = seconds  # at the last `hold`
        self._since: float | None = None  # the last `start`; None while it is held

    def reset(self) -> None:
        self._left, self._since = self._seconds, None

    def start(self, now: float) -> None:
        self._since = now

    def hold(self, now: float) -> None:
        self._left, self._since = self.left(now), None

    def left(self, now: float) -> float:
        left = self._left - (now - self._since if self._since is not None else 0.0)
        return left if left > 1e-6 else 0.0  # a rounding error is not worth a wait
