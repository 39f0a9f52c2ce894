"""The task manager: everything that can be asked of the robot's tasks, without any network."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Sequence
from functools import partial

from taskrpc.errors import TaskRpcError
from taskrpc.request_ids.ids import Completion
from taskrpc.robot.protocol import Pose, Robot, TargetError
from taskrpc.tasks.answers import Answer, Resumed, again, by, priority_refusal, shown, unstored
from taskrpc.tasks.model import EstimateChange, State, Task
from taskrpc.tasks.queue.task_queue import TaskQueue
from taskrpc.tasks.queue.timetable import Timetable
from taskrpc.tasks.records.change_feed import Board
from taskrpc.tasks.records.repository import TaskBook, Then, settle
from taskrpc.tasks.records.store import TaskStore
from taskrpc.tasks.robot_guard import RobotGuard, checked_plan, sentence
from taskrpc.tasks.task_run import Run
from taskrpc.tasks.worker import Worker

_log = logging.getLogger("taskrpc.tasks")

_TOLERANCE = 0.005  # real seconds by which a run may end late before its followers are told


Completing = Callable[[Answer], Completion | None]
"""What makes of an answer the completion of the request that gets it."""


class TaskManager:
    """Accepts tasks, lets the robot do them in order, and remembers what became of them.

    Args:
        robot: the robot, an object that follows the `Robot` protocol.
        store: where tasks survive the server.
        queue_limit: how many tasks may wait.
        share: how many of them may be of one account at one machine; None for all.
        settle: real seconds that an idle robot waits for company before it takes the first task.
        keep_ended: how many ended tasks are remembered, besides the interrupted ones.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        robot: Robot,
        store: TaskStore,
        *,
        queue_limit: int = 10_000,
        share: int | None = None,
        settle: float = 0.1,
        keep_ended: int = 1000,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self._guard = RobotGuard(robot)
        self.is_closed = False
        """Whether `close` has begun, so that nothing more may be asked."""
        self._wall_clock = wall_clock
        self._queue_limit = queue_limit
        self._share = share
        self.board = Board(max(1, int(wall_clock() * 1000)))
        """Tells who waits for it what has changed."""
        self.book = TaskBook(store, self.board, keep_ended=keep_ended)
        """Every task that is remembered."""
        self.queue = TaskQueue(self._guard.plan, self._guard.pose())
        """The tasks that wait."""
        tolerance = _TOLERANCE * max(1.0, self._guard.speed)
        self._timetable = Timetable(self.queue, tolerance=tolerance)
        self._worker = Worker(
            self._guard, self._timetable, self.book, settle=settle, wall_clock=wall_clock
        )

    # Its life

    async def start(self) -> Resumed:
        """Take up the store's tasks and begin to work.

        Raises:
            StoreError: the store cannot be used.
        """
        tasks = await self.book.open()
        begun = [task for task in tasks if task.state.is_begun]
        if begun:
            await self.book.save(*(self._interrupted(task) for task in begun))
        queued = [task for task in tasks if task.state is State.QUEUED]
        self._worker.reckon()
        now = self._worker.now()
        for task in sorted(queued, key=lambda task: task.key):
            waited = max(0.0, self._wall_clock() - task.submitted_at) * self._guard.speed
            self._timetable.resume(task, now, waited=waited)
        self._worker.start(paused=self.book.was_paused)
        return Resumed(len(queued), tuple(sorted(self.book.interrupted)), self.is_paused)

    async def close(self) -> None:
        """Halt the robot, store what ran as INTERRUPTED, answer the watchers, close the store.

        Ask for nothing afterwards.
        """
        self.is_closed = True
        self.board.close()
        await self._worker.close()
        await self.book.close()

    # What may be asked

    def __str__(self) -> str:
        """What there is to do, as a user reads it."""
        waiting = len(self.queue)
        parts = [f"{waiting or 'no'} task{'' if waiting == 1 else 's'} in the queue"]
        if self.running is not None:
            parts.append(f"task {self.running.task_id} in hand")
        if self.is_paused:
            parts.append("the queue is paused")
        if count := len(self.book.interrupted):
            tasks = "interrupted task waits" if count == 1 else "interrupted tasks wait"
            parts.append(f"{count} {tasks} for a decision (taskrpc task list --all)")
        return ", ".join(parts)

    @property
    def is_paused(self) -> bool:
        """Whether the queue stands still until `resume`."""
        return self._worker.is_paused

    @property
    def running(self) -> Task | None:
        """The task that the robot has in hand."""
        run = self._worker.run
        return self.book.find(run.task.task_id) if run else None

    def pose(self) -> Pose:
        """Where the robot is, or was when it last said."""
        return self._guard.pose()

    def reckon(self) -> None:
        """Bring the estimates up to date; do so before asking for them."""
        self._worker.reckon()

    def seconds_ahead(self) -> float:
        """Robot seconds until the first task of the queue can begin."""
        return self._timetable.seconds_ahead(self._worker.now())

    def estimate(self, task_id: int) -> float:
        """Robot seconds until a task is done; 0.0 once it has ended."""
        return self._timetable.estimate(task_id, self._worker.now())

    def changes(self, task: Task) -> Sequence[EstimateChange]:
        """Why a task is or was not done when it was promised, oldest first."""
        if task.state.is_ended:
            return task.changes
        return self._timetable.changes(task.task_id, self._worker.now())

    # What may be done; each returns when it is stored

    async def submit(
        self,
        task_type: str,
        target: str,
        priority: int,
        *,
        client: str = "",
        account: str = "",
        machine: str = "",
        completing: Completing | None = None,
    ) -> Answer:
        """Queue a task, or say what is wrong with it.

        `account` is the caller's, where there are accounts; `client` is the same then. One account
        may be a whole class, so that its shares are told apart by `machine`.
        `completing` is asked for the request's completion once the answer is known; what it
        returns is stored together with the task. A refusal is not remembered.

        Raises:
            StoreError: it could not be stored, and so was not queued.
            OutcomeUnknown: it was not queued, but the next server may find it stored.
        """
        stored = asyncio.get_running_loop().create_future()
        answer = self.submit_then(
            partial(settle, stored),
            task_type,
            target,
            priority,
            client=client,
            account=account,
            machine=machine,
            completing=completing,
        )
        if answer.success:
            await stored
        return answer

    def submit_then(
        self,
        then: Then,
        task_type: str,
        target: str,
        priority: int,
        *,
        client: str = "",
        account: str = "",
        machine: str = "",
        completing: Completing | None = None,
    ) -> Answer:
        """Do as `submit` does, and call back when the task is stored, with what it raises, or None.

        Returns the answer, which holds from then on; a refusal at once, and nobody is called back.
        """
        if refusal := self._refusal(task_type, target, priority, account, machine):
            return Answer(False, refusal)
        task = Task(
            task_id=self.book.new_id(),
            task_type=task_type,
            target=target,
            priority=priority,
            arrival=self.book.new_arrival(),
            submitted_at=self._wall_clock(),
            client=client,
            machine=machine if account else "",
        )

        def stored(error: BaseException | None) -> None:
            if error is None:
                _log.info(
                    "Task %d queued: %s to %s (priority: %d)",
                    task.task_id,
                    task_type,
                    target,
                    priority,
                    extra={"task": task.task_id},
                )
            then(error)

        return self._accept(stored, task, completing)

    async def cancel(self, task_id: int, *, client: str = "") -> Answer:
        """Call a task off, whether it waits or runs."""
        reason = by("cancelled", client)
        # Halting the robot does not wait for the disk.
        if not self._runs(task_id) and await self._waits(task_id):
            return await self._call_off(task_id, reason)
        if run := self._runs(task_id):
            try:
                is_over = await self._worker.cancel(run, reason)
            except TaskRpcError as error:  # the robot obeys, whatever the disk says
                return self._done(f"Task {task_id} is being cancelled{unstored(error)}", run.task)
            if not is_over:
                return self._done(f"Task {task_id} is being cancelled", run.task)
            if run.task.state is State.CANCELED:
                return self._done(f"Task {task_id} was cancelled", run.task)
        if (task := self.book.find(task_id)) and task.state is State.CANCELED:
            return self._done(f"Task {task_id} is cancelled already", task)
        return self._refuse(task_id, "cannot be cancelled any more")

    async def drop(self, task_id: int, *, client: str = "") -> Answer:
        """Give up a task that waits or was interrupted."""
        reason = by("dropped", client)
        if await self._waits(task_id):
            return await self._call_off(task_id, reason)
        task = self.book.find(task_id)
        if task and task.state is State.INTERRUPTED:
            await self.book.save(task.ended(State.CANCELED, self._wall_clock(), message=reason))
            return self._done(f"Task {task_id} was dropped", task)
        if task and task.state is State.CANCELED:
            return self._done(f"Task {task_id} is dropped already", task)
        return self._refuse(task_id, "only a queued or interrupted task can be dropped")

    async def reprioritise(self, task_id: int, priority: int) -> Answer:
        """Move a queued task to another priority."""
        if refusal := priority_refusal(priority):
            return Answer(False, refusal)
        if not await self._waits(task_id):
            return self._refuse(task_id, "only a queued task can be moved")
        self.reckon()
        moved = self._timetable.rerank(task_id, priority)

        def undo() -> None:
            if stored := self.book.find(task_id):
                self.reckon()
                self._timetable.rerank(task_id, stored.priority)

        await self.book.save(moved, undo=undo)
        return self._done(f"Task {task_id} has priority {priority}", moved)

    async def requeue(self, task_id: int, *, resume: bool = False) -> Answer:
        """Queue a task once more that was interrupted, failed or cancelled, behind its equals.

        With `resume` an interrupted one takes the place that it had, before its later equals.
        """
        waits = await self._waits(task_id)
        task = self.book.find(task_id)
        if task and waits:
            return self._done(f"Task {task_id} is queued already", task)
        if task is None or State.QUEUED not in task.may_become:
            return self._refuse(
                task_id, "only one that was interrupted, failed or cancelled can be queued again"
            )
        if resume and task.state is not State.INTERRUPTED:
            return self._refuse(task_id, f"only an interrupted task goes on; {again(task_id)}")
        if refusal := self._refusal(task.task_type, task.target, task.priority):
            return Answer(False, refusal)
        arrival = task.arrival if resume else self.book.new_arrival()
        stored = asyncio.get_running_loop().create_future()
        requeued = task.requeued(self._wall_clock(), arrival)
        answer = self._accept(partial(settle, stored), requeued)
        await stored
        return answer

    async def pause(self) -> Answer:
        """Halt the robot in mid-task and begin no other."""
        said = "The queue is paused"
        try:
            failure = await self._worker.pause()
            await self.book.remember_pause(True)
        except TaskRpcError as error:
            return Answer(True, said + unstored(error))
        return Answer(False, f"{said}, but {failure}") if failure else Answer(True, said)

    async def resume(self) -> Answer:
        """Go on after a pause or a stop."""
        await self.book.remember_pause(False)
        if failure := await self._worker.resume():
            return Answer(False, f"The queue goes on, but {failure}")
        return Answer(True, "The queue goes on")

    async def stop(self, *, client: str = "") -> Answer:
        """Halt the robot at once and pause the queue; the running task ends CANCELED."""
        run = self._worker.run
        failure = await self._worker.stop(by("the robot was stopped", client))
        note = ""
        if run and run.task.state is State.CANCELED:
            note = f"; task {run.task.task_id} was cancelled ({again(run.task.task_id)})"
        try:  # only now: halting may not wait for a disk
            await self.book.remember_pause(True)
        except TaskRpcError as error:
            note += unstored(error)
        if failure:
            return Answer(False, f"The queue is paused, but {failure}")
        return Answer(True, f"The robot is stopped and the queue is paused{note}")

    # How

    def _refusal(
        self, task_type: str, target: str, priority: int, account: str = "", machine: str = ""
    ) -> str:
        robot = self._guard.robot
        if task_type not in robot.task_types:
            expected = " or ".join(", ".join(robot.task_types).rsplit(", ", 1))
            return f"Invalid task: {shown(task_type)} (expected {expected})"
        try:
            checked_plan(robot, task_type, target, self._guard.pose())
        except TargetError as error:
            return f"Invalid target: {sentence(error)[:400]}"
        except Exception as error:
            return f"The robot cannot plan this task: {sentence(error)[:400]}"
        if refusal := priority_refusal(priority):
            return refusal
        if len(self.queue) >= self._queue_limit:
            return f"Queue full: {len(self.queue)} tasks wait, and no more may"
        return self._share_refusal(account, machine)

    def _share_refusal(self, account: str, machine: str) -> str:
        if self._share is None or not account:
            return ""
        waiting = self.queue.waiting_of(account, machine)
        if waiting < self._share:
            return ""
        if machine:
            account = f"{account} at {machine}"
        return f"Share full: {waiting} tasks of {account} wait, and no more of one account may"

    def _accept(self, then: Then, task: Task, completing: Completing | None = None) -> Answer:
        self.reckon()
        accepted = self._timetable.accept(task, self._worker.now())
        answer = self._queued(accepted)

        def undo() -> None:
            if task.task_id in self.queue:
                self._timetable.remove(task.task_id, "could not be stored")

        try:
            completion = completing(answer) if completing else None
        except BaseException:
            undo()
            raise
        self.book.save_then(then, accepted, completion=completion, undo=undo)
        return answer

    async def _call_off(self, task_id: int, reason: str) -> Answer:
        self.reckon()
        removed = self._timetable.remove(task_id, "was cancelled")
        task = removed.task

        def undo() -> None:
            self.reckon()
            self._timetable.undo_remove(removed, "could not be cancelled")

        ended = task.ended(State.CANCELED, self._wall_clock(), message=reason)
        await self.book.save(ended, undo=undo)
        return self._done(f"Task {task_id} was cancelled", task)

    async def _waits(self, task_id: int) -> bool:
        """Whether a task is in the queue, once nothing about it is on its way to the store.

        Two changes on their way could be refused one by one, and what undoes the second would
        bring back what the first has never been.
        """
        await self.book.stored(task_id)
        return task_id in self.queue

    def _runs(self, task_id: int) -> Run | None:
        run = self._worker.run
        return run if run and run.task.task_id == task_id else None

    def _queued(self, task: Task) -> Answer:
        note = " (the queue is paused)" if self.is_paused else ""
        message = f"Task queued: {task.task_type}{note}"
        return Answer(True, message, task.task_id, task.accepted_estimate)

    def _interrupted(self, task: Task) -> Task:
        message = "the server ended while it ran"
        return task.ended(State.INTERRUPTED, self._wall_clock(), message=message)

    def _done(self, message: str, task: Task) -> Answer:
        return Answer(True, message, task.task_id, self.estimate(task.task_id))

    def _refuse(self, task_id: int, rule: str) -> Answer:
        task = self.book.find(task_id)
        if task is None:
            return Answer(False, f"There is no task {task_id}")
        return Answer(False, f"Task {task_id} is {task.state.value}: {rule}")
