"""The task manager: all operations on the robot's tasks, without any network."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from taskrpc.errors import TaskRpcError
from taskrpc.robot.protocol import Robot
from taskrpc.tasks.managed import Completing, QueueSettings, RobotStatus
from taskrpc.tasks.managed_robot import ManagedRobot
from taskrpc.tasks.model import RUNNING_KEY, EstimateChange, OrderKey, Task, TaskState
from taskrpc.tasks.queue.estimate_log import DelayLog
from taskrpc.tasks.queue.estimated_queue import EstimatedQueue
from taskrpc.tasks.queue.journal import JournaledQueue, QueueJournal
from taskrpc.tasks.queue.task_queue import TaskQueue
from taskrpc.tasks.records.change_feed import ChangeFeed
from taskrpc.tasks.records.repository import OnStored, TaskRepository, resolve_future
from taskrpc.tasks.records.store import TaskStore
from taskrpc.tasks.responses import (
    SERVER_ENDED,
    Resumed,
    TaskResponse,
    by_client,
    no_fleet,
    priority_refusal,
    queue_full,
    refused,
    requeue_hint,
    requeue_refusal,
    share_full,
    task_queued,
    unknown_type,
    unstored_note,
)
from taskrpc.tasks.task_execution import TaskExecution
from taskrpc.tasks.worker import Worker
from taskrpc.transport.time_of_day import time_of_day

_log = logging.getLogger("taskrpc.tasks")

_TOLERANCE = 0.005  # real seconds that an execution may be late before the estimates change


class TaskSettings(QueueSettings, frozen=True, kw_only=True):
    """The settings of a task manager."""

    keep_ended: int = 1000
    """How many ended tasks are remembered, besides the interrupted ones."""
    wall_clock: Callable[[], float] = time_of_day
    """Returns the time of day in seconds since 1970."""
    journal: QueueJournal | None = None
    """Takes each step of the queue, for a recording; None for no journal."""


class TaskManager(ManagedRobot):
    """Accepts tasks, lets the robot execute them in order, and remembers how they ended.

    Args:
        robot: the robot, an object that follows the `Robot` protocol.
        store: keeps the tasks for the next server.
        settings: limits and times; the defaults if omitted.
    """

    def __init__(
        self, robot: Robot, store: TaskStore, settings: TaskSettings | None = None
    ) -> None:
        super().__init__(robot)
        self._settings = settings = settings or TaskSettings()
        # A server's first revision must be above all revisions of earlier servers. So it is the
        # time in milliseconds since 1970.
        self.change_feed = ChangeFeed(max(1, int(settings.wall_clock() * 1000)))
        """Announces every change to watchers."""
        self.repository: TaskRepository = TaskRepository(
            store, self.change_feed, keep_ended=settings.keep_ended
        )
        """Every remembered task."""
        self._estimated_queue = self._make_queue(settings.journal)
        self.queue = self._estimated_queue.queue
        """The queued tasks."""
        self._worker = Worker(
            self._robot_guard,
            self._estimated_queue,
            self.repository,
            settle=settings.settle,
            wall_clock=settings.wall_clock,
        )

    def _make_queue(self, journal: QueueJournal | None) -> EstimatedQueue:
        plan, pose = self._robot_guard.plan, self._robot_guard.pose()
        tolerance = _TOLERANCE * max(1.0, self._robot_guard.speed)
        if journal is None:
            return EstimatedQueue(TaskQueue(plan, pose), tolerance=tolerance)
        return JournaledQueue(plan, pose, tolerance=tolerance, journal=journal)

    # Start and end

    async def start(self) -> Resumed:
        """Queue the store's tasks again and start the worker.

        Raises:
            StoreError: the store cannot be used.
        """
        tasks = await self.repository.open()
        begun = [task for task in tasks if task.state.is_begun]
        if begun:
            await self.repository.save(*(self._interrupted(task) for task in begun))
        queued = [task for task in tasks if task.state is TaskState.QUEUED]
        self._worker.update_estimates()
        now = self._worker.now()
        for task in sorted(queued, key=lambda task: task.order_key):
            waited = max(0.0, self._settings.wall_clock() - task.submitted_at)
            self._estimated_queue.resume(task, now, waited=waited * self._robot_guard.speed)
        self._worker.start(paused=self.repository.was_paused)
        return Resumed(len(queued), tuple(sorted(self.repository.interrupted)), self.is_paused)

    async def close(self) -> None:
        """Halt the robot, store the running task as INTERRUPTED and close the store.

        It wakes the watchers. Call no other method afterwards.
        """
        self.is_closed = True
        self.change_feed.close()
        await self._worker.close()
        await self.repository.close()

    # Queries

    def __str__(self) -> str:
        """The state of the queue as a sentence for users."""
        waiting = len(self.queue)
        parts = [f"{waiting or 'no'} task{'' if waiting == 1 else 's'} in the queue"]
        if self.running is not None:
            parts.append(f"task {self.running.task_id} is running")
        if self.is_paused:
            parts.append("the queue is paused")
        if count := len(self.repository.interrupted):
            tasks = "interrupted task waits" if count == 1 else "interrupted tasks wait"
            parts.append(f"{count} {tasks} for a decision (taskrpc task list --all)")
        return ", ".join(parts)

    @property
    def is_paused(self) -> bool:
        """Whether the queue is paused until `resume`."""
        return self._worker.is_paused

    @property
    def _execution(self) -> TaskExecution | None:
        return self._worker.execution

    @property
    def delays(self) -> DelayLog:
        """Why estimates have changed, newest events last; read it only."""
        return self._estimated_queue.log

    def update_estimates(self) -> None:
        """Bring the estimates up to date; call it before reading them."""
        self._worker.update_estimates()

    def seconds_ahead(self) -> float:
        """Return the robot seconds until the first queued task can begin."""
        return self._estimated_queue.seconds_ahead(self._worker.now())

    def estimate(self, task_id: int) -> float:
        """Return the robot seconds to a task's end; 0.0 once it has ended."""
        return self._estimated_queue.estimate(task_id, self._worker.now())

    def changes(self, task: Task) -> Sequence[EstimateChange]:
        """Return why a task does not end at its accepted estimate, oldest change first."""
        if task.state.is_ended:
            return task.changes
        return self._estimated_queue.changes(task.task_id, self._worker.now())

    def begun(self) -> Sequence[tuple[OrderKey, Task]]:
        """Return the running task with its place before the queue."""
        running = self.running
        return [] if running is None else [(RUNNING_KEY, running)]

    def waiting(self, after: OrderKey) -> Iterator[tuple[OrderKey, Task, float]]:
        """Iterate over the stored queued tasks behind a place, in order; see `ManagedTasks`."""
        ahead = self.seconds_ahead()
        for queued, seconds in self.queue.ordered(max(after, RUNNING_KEY)):
            if task := self.repository.find(queued.task_id):  # None while it is not stored yet
                yield queued.order_key, task, ahead + seconds

    def planned_robot(self, task: Task) -> str:
        """Return "": there is only one robot."""
        return ""

    def waits_for(self, task: Task) -> str:
        """Return "": there is only one robot, and it works."""
        return ""

    def robots(self) -> Sequence[RobotStatus]:
        """Return nothing: there is no fleet."""
        return ()

    # Changes; each returns when it is stored

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
    ) -> TaskResponse:
        """Queue a task, or refuse it with the reason.

        `account` is the caller's account if the server has accounts; then `client` is the same. A
        whole class may use one account, so each `machine` has a share of its own.
        `completing` makes the request's completion from the response; the completion is stored
        together with the task. A refusal is not stored.

        Raises:
            StoreError: the task could not be stored, so it was not queued.
            OutcomeUnknown: it was not queued, but the next server may find it stored.
        """
        stored = asyncio.get_running_loop().create_future()
        response = self.submit_with_callback(
            partial(resolve_future, stored),
            task_type,
            target,
            priority,
            client=client,
            account=account,
            machine=machine,
            completing=completing,
        )
        if response.success:
            await stored
        return response

    def submit_with_callback(
        self,
        on_stored: OnStored,
        task_type: str,
        target: str,
        priority: int,
        *,
        client: str = "",
        account: str = "",
        machine: str = "",
        completing: Completing | None = None,
    ) -> TaskResponse:
        """Do as `submit` does, and call `on_stored` when the task is stored.

        Returns the response, which is valid from then on. A refusal is valid at once, and
        `on_stored` is not called.
        """
        if refusal := self._refusal(task_type, target, priority, account, machine):
            return TaskResponse(False, refusal)
        task = Task(
            task_id=self.repository.new_id(),
            task_type=task_type,
            target=target,
            priority=priority,
            arrival=self.repository.new_arrival(),
            submitted_at=self._settings.wall_clock(),
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
            on_stored(error)

        return self._accept(stored, task, completing)

    async def cancel(self, task_id: int, *, client: str = "") -> TaskResponse:
        """Cancel a queued or running task."""
        reason = by_client("cancelled", client)
        # `_is_queued` may wait for the disk; a running task must halt at once.
        if not self._running(task_id) and await self._is_queued(task_id):
            return await self._cancel_queued(task_id, reason)
        if execution := self._running(task_id):
            try:
                is_over = await self._worker.cancel(execution, reason)
            except TaskRpcError as error:  # the robot halts although the disk failed
                message = f"Task {task_id} is being cancelled{unstored_note(error)}"
                return self._done(message, execution.task)
            if not is_over:
                return self._done(f"Task {task_id} is being cancelled", execution.task)
            if execution.task.state is TaskState.CANCELED:
                return self._done(f"Task {task_id} was cancelled", execution.task)
        if (task := self.repository.find(task_id)) and task.state is TaskState.CANCELED:
            return self._done(f"Task {task_id} is cancelled already", task)
        return self._refuse(task_id, "cannot be cancelled any more")

    async def drop(self, task_id: int, *, client: str = "") -> TaskResponse:
        """Cancel a queued or interrupted task without running it."""
        reason = by_client("dropped", client)
        if await self._is_queued(task_id):
            return await self._cancel_queued(task_id, reason)
        task = self.repository.find(task_id)
        if task and task.state is TaskState.INTERRUPTED:
            now = self._settings.wall_clock()
            await self.repository.save(task.ended(TaskState.CANCELED, now, message=reason))
            return self._done(f"Task {task_id} was dropped", task)
        if task and task.state is TaskState.CANCELED:
            return self._done(f"Task {task_id} is dropped already", task)
        return self._refuse(task_id, "only a queued or interrupted task can be dropped")

    async def reprioritise(self, task_id: int, priority: int) -> TaskResponse:
        """Move a queued task to another priority."""
        if refusal := priority_refusal(priority):
            return TaskResponse(False, refusal)
        if not await self._is_queued(task_id):
            return self._refuse(task_id, "only a queued task can be moved")
        self.update_estimates()
        moved = self._estimated_queue.reprioritise(task_id, priority)

        def undo() -> None:
            if stored := self.repository.find(task_id):
                self.update_estimates()
                self._estimated_queue.reprioritise(task_id, stored.priority)

        await self.repository.save(moved, undo=undo)
        return self._done(f"Task {task_id} has priority {priority}", moved)

    async def requeue(self, task_id: int, *, resume: bool = False) -> TaskResponse:
        """Queue an interrupted, failed or cancelled task again, as the last of its priority.

        With `resume`, an interrupted task gets back its old place among tasks of its priority.
        """
        is_queued = await self._is_queued(task_id)
        task = self.repository.find(task_id)
        if task and is_queued:
            return self._done(f"Task {task_id} is queued already", task)
        if response := requeue_refusal(task, task_id, resume=resume):
            return response
        assert task is not None, "an unknown task is refused"
        if refusal := self._refusal(task.task_type, task.target, task.priority):
            return TaskResponse(False, refusal)
        arrival = task.arrival if resume else self.repository.new_arrival()
        stored = asyncio.get_running_loop().create_future()
        requeued = task.requeued(self._settings.wall_clock(), arrival)
        response = self._accept(partial(resolve_future, stored), requeued)
        await stored
        return response

    async def pause(self, *, robot: str = "") -> TaskResponse:
        """Halt the robot during its task and begin no other task; refuse a `robot` by name."""
        if robot:
            return no_fleet(robot)
        said = "The queue is paused"
        try:
            failure = await self._worker.pause()
            await self.repository.remember_pause(True)
        except TaskRpcError as error:
            return TaskResponse(True, said + unstored_note(error))
        return (
            TaskResponse(False, f"{said}, but {failure}") if failure else TaskResponse(True, said)
        )

    async def resume(self, *, robot: str = "") -> TaskResponse:
        """Continue after a pause or a stop; refuse a `robot` by name."""
        if robot:
            return no_fleet(robot)
        await self.repository.remember_pause(False)
        if failure := await self._worker.resume():
            return TaskResponse(False, f"The queue is resumed, but {failure}")
        return TaskResponse(True, "The queue is resumed")

    async def stop(self, *, client: str = "", robot: str = "") -> TaskResponse:
        """Halt the robot at once and pause the queue; the running task ends CANCELED.

        A `robot` by name is refused.
        """
        if robot:
            return no_fleet(robot)
        execution = self._worker.execution
        failure = await self._worker.stop(by_client("the robot was stopped", client))
        note = ""
        if execution and execution.task.state is TaskState.CANCELED:
            task_id = execution.task.task_id
            note = f"; task {task_id} was cancelled ({requeue_hint(task_id)})"
        try:  # after the halt, which must not wait for the disk
            await self.repository.remember_pause(True)
        except TaskRpcError as error:
            note += unstored_note(error)
        if failure:
            return TaskResponse(False, f"The queue is paused, but {failure}")
        return TaskResponse(True, f"The robot is stopped and the queue is paused{note}")

    def reset_robot(self) -> str:
        """Put the idle robot to its start; returns why it stays where it is, "" if it does not."""
        reset = getattr(self.robot, "reset", None)
        if reset is None:
            return "the robot stays where it is: its class has no method `reset`"
        return self._robot_guard.command(reset)

    # Internals

    def _refusal(
        self, task_type: str, target: str, priority: int, account: str = "", machine: str = ""
    ) -> str:
        robot = self._robot_guard.robot
        if task_type not in robot.task_types:
            return unknown_type(task_type, robot.task_types)
        if refusal := self._robot_guard.refusal(task_type, target):
            return refusal
        if refusal := priority_refusal(priority):
            return refusal
        limit = self._settings.queue_limit
        if len(self.queue) >= limit:
            return queue_full(len(self.queue), limit)
        return self._share_refusal(account, machine)

    def _share_refusal(self, account: str, machine: str) -> str:
        share = self._settings.share
        if share is None or not account:
            return ""
        waiting = self.queue.count_waiting(account, machine)
        return share_full(account, machine, waiting, share) if waiting >= share else ""

    def _accept(
        self, on_stored: OnStored, task: Task, completing: Completing | None = None
    ) -> TaskResponse:
        self.update_estimates()
        accepted = self._estimated_queue.accept(task, self._worker.now())
        response = self._queued(accepted)

        def undo() -> None:
            if task.task_id in self.queue:
                self._estimated_queue.remove(task.task_id, "could not be stored")

        try:
            completion = completing(response) if completing else None
        except BaseException:
            undo()
            raise
        self.repository.save_with_callback(on_stored, accepted, completion=completion, undo=undo)
        return response

    async def _cancel_queued(self, task_id: int, reason: str) -> TaskResponse:
        self.update_estimates()
        removed = self._estimated_queue.remove(task_id, "was cancelled")
        task = removed.task

        def undo() -> None:
            self.update_estimates()
            self._estimated_queue.undo_remove(removed, "could not be cancelled")

        ended = task.ended(TaskState.CANCELED, self._settings.wall_clock(), message=reason)
        await self.repository.save(ended, undo=undo)
        return self._done(f"Task {task_id} was cancelled", task)

    async def _is_queued(self, task_id: int) -> bool:
        """Wait until all changes of a task are stored; return whether it is queued.

        If two changes of a task were being stored, the store could refuse both. The undo of the
        second change would then restore the state after the first, which was never stored.
        """
        await self.repository.stored(task_id)
        return task_id in self.queue

    def _queued(self, task: Task) -> TaskResponse:
        return task_queued(task, task.accepted_estimate, paused=self.is_paused)

    def _interrupted(self, task: Task) -> Task:
        now = self._settings.wall_clock()
        return task.ended(TaskState.INTERRUPTED, now, message=SERVER_ENDED)

    def _done(self, message: str, task: Task) -> TaskResponse:
        return TaskResponse(True, message, task.task_id, self.estimate(task.task_id))

    def _refuse(self, task_id: int, rule: str) -> TaskResponse:
        return refused(self.repository.find(task_id), task_id, rule)
