"""The worker: takes one task after another from the queue and lets the robot do it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable

from taskrpc.errors import TaskRpcError
from taskrpc.tasks.model import State, Task
from taskrpc.tasks.queue.timetable import Timetable
from taskrpc.tasks.records.repository import TaskBook
from taskrpc.tasks.robot_guard import RobotGuard
from taskrpc.tasks.task_run import Run

_log = logging.getLogger("taskrpc.tasks")

_ENDINGS = {State.CANCELED: "was cancelled", State.FAILED: "failed"}
_PATIENCE = 1.0  # real seconds that a robot may take to let go of its task


class Worker:
    """Runs the queue's tasks, one at a time, from `start` until `close`.

    Args:
        guard: the robot.
        timetable: the queue and its promises.
        book: where every change is stored before it is announced.
        settle: real seconds that an idle worker waits for company before it takes a task.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        guard: RobotGuard,
        timetable: Timetable,
        book: TaskBook,
        *,
        settle: float,
        wall_clock: Callable[[], float],
    ) -> None:
        self.run: Run | None = None
        """The task that the robot has in hand."""
        self._guard = guard
        self._timetable = timetable
        self._book = book
        self._wall_clock = wall_clock
        self._company = _Countdown(settle)
        self._may_go = asyncio.Event()
        self._may_go.set()
        self._halted = asyncio.Event()
        self._worker: asyncio.Task[None] | None = None

    @property
    def is_paused(self) -> bool:
        """Whether the queue stands still until `resume`."""
        return not self._may_go.is_set()

    def start(self, *, paused: bool = False) -> None:
        """Begin to take tasks, or to wait for `resume`."""
        if paused:
            self._may_go.clear()
            self._halted.set()
        self._worker = asyncio.create_task(self._work(), name="taskrpc worker")

    async def close(self) -> None:
        """Halt the robot and end; the running task is stored as INTERRUPTED."""
        if self._worker is None:
            return
        self._hold()
        if run := self.run:
            run.interrupt("the server ended while it ran")
            if not await self._is_over(run):
                run.abandon()
                await run.is_over.wait()
        self._worker.cancel()
        await asyncio.wait({self._worker})

    def now(self) -> float:
        """The robot's clock: robot seconds."""
        return asyncio.get_running_loop().time() * self._guard.speed

    def reckon(self) -> None:
        """Bring the timetable up to date, before somebody asks it."""
        if self.run is None:
            self._timetable.rebase(self._guard.pose(), "the robot was moved")
        self._reckon(self._cause)

    async def pause(self) -> str:
        """Halt the robot and take no more tasks; returns what went wrong, else an empty text."""
        self._hold()
        return await self.run.pause() if self.run else ""

    async def resume(self) -> str:
        """Undo `pause`; returns what went wrong, else an empty text."""
        robot = self._guard.robot
        failure = await self.run.resume() if self.run else self._guard.order(robot.resume)
        self.reckon()
        self._halted.clear()
        self._may_go.set()
        self._book.board.announce()
        return failure

    async def stop(self, message: str) -> str:
        """Halt the robot at once and pause; returns what went wrong, else an empty text."""
        self._hold()
        if (run := self.run) is None:
            return self._guard.order(self._guard.robot.stop)
        failure = run.stop(message)
        is_over = await self._is_over(run)
        return failure or ("" if is_over else "the robot does not let go of its task")

    async def cancel(self, run: Run, message: str) -> bool:
        """Cancel the running task; returns whether it has ended already."""
        self.reckon()
        await run.cancel(message)
        return await self._is_over(run)

    async def _work(self) -> None:
        while True:
            task = await self._take()
            try:
                await self._do(task)
            except TaskRpcError as error:
                _log.error("the queue is paused: %s", error)
                self._hold()
            except Exception:
                _log.exception("the queue is paused: the task server itself failed")
                self._hold()

    async def _take(self) -> Task:
        """Wait for the next task that may begin; nothing may be awaited before it has."""
        queue = self._timetable.queue
        while True:
            if not queue:
                self._company.reset()
            task = await queue.get()
            obstacle = self._obstacle(task)
            if obstacle is None:
                return task
            queue.put_back(task)
            await obstacle

    def _obstacle(self, task: Task) -> Awaitable[object] | None:
        """What has to be waited for before the first task of the queue may begin."""
        if self.is_paused:
            return self._may_go.wait()
        if self._company.left(self._loop_time()) > 0:
            return self._settle()
        if not self._book.is_settled(task.task_id):
            return self._until_stored(task)
        return None

    async def _settle(self) -> None:
        self._company.start(self._loop_time())
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._company.left(self._loop_time())):
                await self._halted.wait()
        self._company.hold(self._loop_time())

    async def _until_stored(self, task: Task) -> None:
        stored = await self._book.stored(task.task_id)
        if not stored and task.task_id in self._timetable.queue:
            self._timetable.remove(task.task_id, "was never stored")

    async def _do(self, task: Task) -> None:
        self.reckon()
        planned = self._timetable.begin(task)
        self.run = run = Run(self._guard, self._book, task, planned, self._wall_clock)
        try:
            await run.begin()
        except TaskRpcError:
            self.run = None
            self._timetable.undo_begin(task, self._guard.pose(), planned)
            raise
        try:
            cause = _ENDINGS.get(await run.wait())
            cause = f"task {task.task_id} {cause}" if cause else self._cause()
            self._reckon(lambda: cause)
            changes = self._timetable.end(self.now())
            self._timetable.rebase(self._guard.pose(), cause)
            await run.end(changes)
        finally:
            self.run = None

    def _reckon(self, cause: Callable[[], str]) -> None:
        self._timetable.reckon(self.now() + self._busy(), cause)

    def _busy(self) -> float:
        """Robot seconds until the first queued task can begin, if nobody holds it up."""
        if self.run is not None:
            return self.run.remaining()
        return self._company.left(self._loop_time()) * self._guard.speed

    def _cause(self) -> str:
        """Why the robot will be free at another time than was presumed."""
        if self.is_paused:
            return "the queue was paused"
        if self.run is None:
            return "the task server was late"
        late = self._timetable.drift(self.now() + self._busy()) > 0
        return f"task {self.run.task.task_id} took {'longer' if late else 'less time'} than planned"

    def _hold(self) -> None:
        if self.is_paused:
            return
        self.reckon()
        self._may_go.clear()
        self._halted.set()
        self._company.hold(self._loop_time())
        self._book.board.announce()

    async def _is_over(self, run: Run) -> bool:
        """Whether a run that was halted ends soon; a robot may need a moment to let go."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_PATIENCE):
                await run.is_over.wait()
        return run.is_over.is_set()

    @staticmethod
    def _loop_time() -> float:
        return asyncio.get_running_loop().time()


class _Countdown:
    """Seconds that run down only between `start` and `hold`."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._left = seconds
        self._since: float | None = None

    def reset(self) -> None:
        self._left, self._since = self._seconds, None

    def start(self, now: float) -> None:
        self._since = now

    def hold(self, now: float) -> None:
        self._left, self._since = self.left(now), None

    def left(self, now: float) -> float:
        left = self._left - (now - self._since if self._since is not None else 0.0)
        return left if left > 1e-6 else 0.0  # what rounding leaves over is not worth a wait
