"""The task manager: all operations on the robot's tasks, without any network."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.protocol import Robot
from taskrpc.robot.tasks import rules
from taskrpc.robot.tasks.managed import Completing, QueueSettings, RobotStatus
from taskrpc.robot.tasks.managed_robot import ManagedRobot
from taskrpc.robot.tasks.model import (
    RUNNING_KEY,
    EstimateChange,
    OrderKey,
    Task,
    TaskState,
)
from taskrpc.robot.tasks.queue.estimate_log import DelayLog
from taskrpc.robot.tasks.queue.estimated_queue import EstimatedQueue
from taskrpc.robot.tasks.queue.journal import JournaledQueue, QueueJournal
from taskrpc.robot.tasks.queue.task_queue import TaskQueue
from taskrpc.robot.tasks.records.change_feed import ChangeFeed
from taskrpc.robot.tasks.records.repository import OnStored, TaskRepository, resolve_future
from taskrpc.robot.tasks.records.store import TaskStore
from taskrpc.robot.tasks.responses import (
    SERVER_ENDED,
    Resumed,
    TaskResponse,
    by_client,
    commanded,
    no_fleet,
    queue_text,
    stopped_note,
    task_possible,
    task_queued,
    unknown_type,
    unstored_note,
)
from taskrpc.robot.tasks.worker import Worker
from taskrpc.spi import time_of_day

_log = logging.getLogger("taskrpc.tasks")

_TOLERANCE = 0.005  # real seconds that an execution may be late before the estimates change


class TaskSettings(QueueSettings, frozen=True, kw_only=True):
    """The settings of a task manager."""

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
        self.repository: TaskRepository = TaskRepository(store, self.change_feed)
        """Every remembered task."""
        self._estimated_queue = self._make_queue(settings.journal)
        self.queue = self._estimated_queue.queue
        """The queued tasks."""
        self._worker: Worker = Worker(
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
        doing = [] if self.running is None else [f"task {self.running.task_id} is running"]
        interrupted = len(self.repository.interrupted)
        return queue_text(len(self.queue), *doing, paused=self.is_paused, interrupted=interrupted)

    @property
    def is_paused(self) -> bool:
        """Whether the queue is paused until `resume`."""
        return self._worker.is_paused

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

    def preview(
        self, task_type: str, target: str, priority: int, *, account: str = "", machine: str = ""
    ) -> TaskResponse:
        """Return what `submit` would respond now, without queueing a task."""
        if problem := self._refusal(task_type, target, priority, account, machine):
            return TaskResponse(False, problem)
        self.update_estimates()
        task = Task.possible(task_type, target, priority, self._settings.wall_clock())
        seconds = self.seconds_ahead() + self.queue.seconds_with(task)
        return task_possible(task_type, seconds, paused=self.is_paused)

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
        # `stored` may wait for the disk; a running task must halt at once.
        if response := await self._cancel_running(task_id, client):
            return response
        task, now = await self.repository.stored(task_id), self._settings.wall_clock()
        decision = rules.cancel(task, task_id, now, client)
        if isinstance(decision, rules.Halt):  # it has begun meanwhile
            response = await self._cancel_running(task_id, client)
            return response or rules.halted(decision.task, is_over=False)
        return await self._end(decision)

    async def drop(self, task_id: int, *, client: str = "") -> TaskResponse:
        """Cancel a queued or interrupted task without running it."""
        task, now = await self.repository.stored(task_id), self._settings.wall_clock()
        return await self._end(rules.drop(task, task_id, now, client))

    async def reprioritise(self, task_id: int, priority: int, *, client: str = "") -> TaskResponse:
        """Move a queued task to another priority."""
        task, now = await self.repository.stored(task_id), self._settings.wall_clock()
        decision = rules.reprioritise(task, task_id, priority, now, client)
        if not isinstance(decision, rules.Change):
            return decision
        self.update_estimates()
        moved = self._estimated_queue.reprioritise(task_id, priority)
        moved = msgspec.structs.replace(moved, decisions=decision.task.decisions)
        self.queue.replace(moved)

        def undo() -> None:
            if stored := self.repository.find(task_id):
                self.update_estimates()
                self._estimated_queue.reprioritise(task_id, stored.priority)
                self.queue.replace(stored)

        await self.repository.save(moved, undo=undo)
        return TaskResponse(True, decision.message, task_id, self.estimate(task_id))

    async def requeue(
        self, task_id: int, *, resume: bool = False, client: str = ""
    ) -> TaskResponse:
        """Queue an interrupted, failed or cancelled task again, as the last of its priority.

        With `resume`, an interrupted task gets back its old place among tasks of its priority.
        """
        task, now = await self.repository.stored(task_id), self._settings.wall_clock()
        refusal = self._requeue_refusal
        decision = rules.requeue(task, task_id, now, client, resume=resume, refusal=refusal)
        if not isinstance(decision, rules.Enqueue):
            seconds = self.estimate(task_id) if decision.success else 0.0
            return msgspec.structs.replace(decision, estimated_time=seconds)
        arrival = decision.task.arrival if decision.keeps_arrival else self.repository.new_arrival()
        stored = asyncio.get_running_loop().create_future()
        requeued = decision.task.requeued(now, arrival)
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
        return commanded(said, failure)

    async def resume(self, *, robot: str = "") -> TaskResponse:
        """Continue after a pause or a stop; refuse a `robot` by name."""
        if robot:
            return no_fleet(robot)
        await self.repository.remember_pause(False)
        return commanded("The queue is resumed", await self._worker.resume())

    async def stop(self, *, client: str = "", robot: str = "") -> TaskResponse:
        """Halt the robot at once and pause the queue; the running task ends CANCELED.

        A `robot` by name is refused.
        """
        if robot:
            return no_fleet(robot)
        execution = self._worker.execution
        failure = await self._worker.stop(by_client("the robot was stopped", client), client)
        note = stopped_note([execution.task] if execution else [])
        try:  # after the halt, which must not wait for the disk
            await self.repository.remember_pause(True)
        except TaskRpcError as error:
            note += unstored_note(error)
        if failure:
            return commanded("The queue is paused", failure)
        return TaskResponse(True, f"The robot is stopped and the queue is paused{note}")

    def reset_robot(self) -> str:
        """Put the idle robot to its start; returns why it stays where it is, "" if it does not."""
        reset = getattr(self.robot, "reset", None)
        if reset is None:
            return "the robot stays where it is: its class has no method `reset`"
        return self._robot_guard.command(reset)

    # Internals

    def _refusal(
        self, task_type: str, target: str, priority: int, account: str, machine: str
    ) -> str:
        """Return why a task is not queued, "" if it is."""
        return rules.refusal(
            self._unable(task_type, target),
            priority,
            self.queue,
            self._settings.queue_limit,
            self._settings.share,
            account,
            machine,
        )

    def _unable(self, task_type: str, target: str) -> str:
        """Return why the robot cannot execute a task, "" if it can."""
        robot = self._robot_guard.robot
        if task_type not in robot.task_types:
            return unknown_type(task_type, robot.task_types)
        return self._robot_guard.refusal(task_type, target)

    def _requeue_refusal(self, task: Task) -> str:
        unable = self._unable(task.task_type, task.target)
        return rules.refusal(unable, task.priority, self.queue, self._settings.queue_limit)

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

    async def _end(self, decision: TaskResponse | rules.Change) -> TaskResponse:
        """Carry out a decision that ends a task which does not run, or that changes nothing."""
        if not isinstance(decision, rules.Change):
            return decision
        task = decision.task
        if task.task_id in self.queue:
            await self._end_queued(task)
        else:
            await self.repository.save(task)
        return TaskResponse(True, decision.message, task.task_id)

    async def _end_queued(self, ended: Task) -> None:
        self.update_estimates()
        removed = self._estimated_queue.remove(ended.task_id, "was cancelled")

        def undo() -> None:
            self.update_estimates()
            self._estimated_queue.undo_remove(removed, "could not be cancelled")

        await self.repository.save(ended, undo=undo)

    def _queued(self, task: Task) -> TaskResponse:
        return task_queued(task, task.accepted_estimate, paused=self.is_paused)

    def _interrupted(self, task: Task) -> Task:
        now = self._settings.wall_clock()
        return task.ended(TaskState.INTERRUPTED, now, message=SERVER_ENDED)
