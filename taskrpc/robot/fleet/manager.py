"""The task manager of one server of a fleet: all operations on the fleet's tasks."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextvars import copy_context
from functools import partial

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.fleet import rules
from taskrpc.robot.fleet.lease import LeaseKeeper, Report
from taskrpc.robot.fleet.model import LEASE
from taskrpc.robot.fleet.offers import waits_for
from taskrpc.robot.fleet.own_robot import OwnRobot
from taskrpc.robot.fleet.plan import HORIZON, FleetPlan, Planned
from taskrpc.robot.fleet.records import FleetRecords
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.fleet.store import FleetStore, RequestKey
from taskrpc.robot.fleet.worker import FleetWorker
from taskrpc.robot.protocol import Robot
from taskrpc.robot.tasks import rules as requests
from taskrpc.robot.tasks.managed import Completing, QueueSettings, RobotStatus
from taskrpc.robot.tasks.managed_robot import ManagedRobot
from taskrpc.robot.tasks.model import RUNNING_KEY, EstimateChange, OrderKey, Task, TaskState
from taskrpc.robot.tasks.queue.estimate_log import DelayLog
from taskrpc.robot.tasks.records.change_feed import ChangeFeed
from taskrpc.robot.tasks.responses import (
    Resumed,
    TaskResponse,
    by_client,
    commanded,
    queue_text,
    stopped_note,
    task_possible,
    unstored_note,
)

_log = logging.getLogger("taskrpc.fleet")

_PLAN_AGE = 0.2  # seconds for which a plan is used again
_FOLLOW_CANCEL = 1.0  # seconds to wait until another server has halted its robot


class FleetSettings(QueueSettings, frozen=True, kw_only=True):
    """The settings of a server of a fleet."""

    name: str = "robot_1"
    """The robot's name, unique in the fleet."""
    capabilities: str = ""
    """What the robot may do; see `taskrpc.robot.fleet.model.Capabilities`. "" for everything."""
    lease: float = LEASE
    """Seconds for which the robot belongs to a server that does not answer any more."""


class FleetManager(ManagedRobot):
    """Accepts tasks for a fleet and lets one robot execute its part of them.

    Args:
        robot: this server's robot, an object that follows the `Robot` protocol.
        store: the fleet's store; `close` closes it.
        settings: see `FleetSettings`.

    Raises:
        ValueError: the capabilities are not valid.
    """

    def __init__(
        self, robot: Robot, store: FleetStore, settings: FleetSettings | None = None
    ) -> None:
        super().__init__(robot)
        self._settings = settings = settings or FleetSettings()
        self.name = settings.name
        self._own_robot = OwnRobot(self.name, self._robot_guard, settings.capabilities)
        self.address: Callable[[], str] = lambda: ""
        """Returns where the server listens, for the error texts of other servers."""
        self.store = store
        self.change_feed = ChangeFeed(max(1, int(store.now() * 1000)))
        """Announces every change to watchers."""
        self.repository: FleetRecords = FleetRecords(
            store, self.change_feed, self.name, self._robot_guard.pose
        )
        """Every remembered task."""
        self.delays = DelayLog()
        """Empty: a fleet keeps no log of why estimates have changed."""
        self.lease = LeaseKeeper(
            store,
            self._own_robot.record(),
            settings.lease,
            report=self._report,
            on_end=self._lease_ended,
            on_joined=self._joined,
        )
        """This server's lease on its robot."""
        self._worker: FleetWorker = FleetWorker(
            self.name,
            self._robot_guard,
            store,
            self.repository,
            self.lease,
            self._own_robot.plan,
            self._own_robot.wrong_target,
            settle=settings.settle,
        )
        self._plan: tuple[int, FleetPlan] | None = None
        """The plan version of the state, and the last plan."""
        store.listeners.append(self._changed)

    # Start and end

    async def start(self) -> Resumed:
        """Join the fleet and start the worker.

        Raises:
            NameTaken: another server drives a robot of this name.
            StoreError: the store cannot be used.
        """
        await self.store.refresh()
        await self.lease.join(self.address())
        self._worker.start()
        state = self.store.state
        return Resumed(len(state), tuple(sorted(state.interrupted)), state.meta.paused)

    async def close(self) -> None:
        """Halt the robot, store its task as INTERRUPTED, leave the fleet and close the store."""
        self.is_closed = True
        self.change_feed.close()
        await self._worker.close()
        try:
            await self.lease.leave()
        except TaskRpcError as error:
            _log.warning("the other servers notice this end only when the lease ends: %s", error)
        self.store.listeners.remove(self._changed)
        await self.store.close()

    def _joined(self, epoch: int) -> None:
        self.repository.epoch = epoch

    def _lease_ended(self) -> None:
        self._worker.lease_ended()

    def _report(self) -> Report:
        execution, pose = self._worker.execution, self._robot_guard.pose()
        if execution is None:
            return Report(pose=pose)
        remaining = execution.remaining() / self._robot_guard.speed
        return Report(max(remaining, 1e-6), execution.task.progress, pose)

    def _changed(self, task_ids: Sequence[int]) -> None:
        self._worker.look()
        for task_id in task_ids:
            self.change_feed.announce(task_id)
        if not task_ids:
            self.change_feed.announce()

    # Queries

    def __str__(self) -> str:
        """The state of the queue as a sentence for users."""
        state = self.store.state
        begun, robots = len(state.begun), len(state.live_robots(self.store.now()))
        doing = [f"{begun} task{' is' if begun == 1 else 's are'} running"] if begun else []
        doing.append(f"{robots} robot{'' if robots == 1 else 's'}")
        interrupted = len(state.interrupted)
        return queue_text(len(state), *doing, paused=self.is_paused, interrupted=interrupted)

    @property
    def queue(self) -> FleetState:
        """The queued tasks; its length is their number."""
        return self.store.state

    @property
    def is_paused(self) -> bool:
        """Whether no robot begins a task until `resume`."""
        return self.store.state.meta.paused or self._worker.is_held

    def begun(self) -> Iterable[tuple[OrderKey, Task]]:
        """Return the tasks that robots execute, each with its place before the queue."""
        for task_id in sorted(self.store.state.begun):
            if task := self.repository.find(task_id):
                yield (RUNNING_KEY[0], task_id), task

    def waiting(self, after: OrderKey) -> Iterator[tuple[OrderKey, Task, float]]:
        """Iterate over the queued tasks behind a place, in order; see `ManagedTasks`."""
        for task in self.store.state.queued(after):
            yield task.order_key, task, self.estimate(task.task_id)

    def planned_robot(self, task: Task) -> str:
        """Return the robot that is planned to execute a queued task, "" if it is not known."""
        if task.state is not TaskState.QUEUED or task.task_id not in self.store.state.tasks:
            return ""
        planned = rules.end_of(self.store.state, self._present_plan(), task)
        return planned.robot if isinstance(planned, Planned) else ""

    def waits_for(self, task: Task) -> str:
        """Return which robots a queued task waits for while none of them works."""
        if task.state is not TaskState.QUEUED:
            return ""
        return waits_for(self.store.state, self.store.now(), task)

    def robots(self) -> Sequence[RobotStatus]:
        """Return the fleet's robots that run, or have run lately, sorted by name."""
        state, now = self.store.state, self.store.now()
        own = state.robots.get(self.name)
        return [
            RobotStatus(
                robot.name,
                robot.activity(now),
                robot.at,
                robot.task_id,
                is_own=robot.name == self.name,
                is_on_map=own is not None and robot.size == own.size,
            )
            for robot in state.known_robots(now)
        ]

    def update_estimates(self) -> None:
        """Do nothing: estimates are computed when they are asked for."""

    def estimate(self, task_id: int) -> float:
        """Return the robot seconds to a task's end.

        0.0 once it has ended, and while no robot can execute it.
        """
        state = self.store.state
        task = state.tasks.get(task_id)
        if task is None or task.state.is_ended:
            return 0.0
        if execution := self._running(task_id):
            return execution.remaining()
        if task.state is not TaskState.QUEUED:
            robot = state.robots.get(task.robot)
            seconds = 0.0 if robot is None else robot.free_at - self.store.now()
        else:
            seconds = self._seconds_to(task, self._present_plan())
        return max(0.0, seconds) * self.speed

    def changes(self, task: Task) -> Sequence[EstimateChange]:
        """Return by how much an ended task ended later than its accepted estimate."""
        return task.changes

    def preview(
        self, task_type: str, target: str, priority: int, *, account: str = "", machine: str = ""
    ) -> TaskResponse:
        """Return what `submit` would respond now, without queueing a task."""
        state, now, settings = self.store.state, self.store.now(), self._settings
        unable = self._own_robot.refusal(state, now, task_type, target)
        if problem := requests.refusal(
            unable, priority, state, settings.queue_limit, settings.share, account, machine
        ):
            return TaskResponse(False, problem)
        task = Task.possible(task_type, target, priority, now)
        end = rules.end_of_new(state, now, task, self._own_robot.plan, self.name)
        seconds = max(0.0, self._seconds_until(end)) * self.speed
        note = waits_for(state, now, task)
        return task_possible(task_type, seconds, paused=self.is_paused, note=note)

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
        request: RequestKey | None = None,
    ) -> TaskResponse:
        """Queue a task, or refuse it with the reason; see `TaskManager.submit`.

        Raises:
            AlreadyCompleted: another server has completed the same `request`.
            StoreError: the task could not be stored, so it was not queued.
            OutcomeUnknown: it may be queued or not.
        """
        settings = self._settings
        task = Task(
            task_id=0,
            task_type=task_type,
            target=target,
            priority=priority,
            arrival=0,
            submitted_at=0.0,
            client=client,
            machine=machine if account else "",
        )
        context = copy_context()

        def action(state: FleetState, now: float) -> TaskResponse:
            response = rules.submit(
                state,
                now,
                task,
                account=account,
                unable=self._own_robot.refusal(state, now, task_type, target),
                queue_limit=settings.queue_limit,
                share=settings.share,
                estimated=partial(self._estimate_in, state, now),
            )
            if response.success and completing is not None:
                state.complete(context.run(completing, response))
            return response

        response = await self.store.transact(action, request)
        if response.success:
            text = "Task %d queued: %s to %s (priority: %d)"
            extra = {"task": response.task_id}
            _log.info(text, response.task_id, task_type, target, priority, extra=extra)
        return response

    async def cancel(self, task_id: int, *, client: str = "") -> TaskResponse:
        """Cancel a queued or running task, wherever it runs."""
        if response := await self._cancel_running(task_id, client):
            return response
        response = await self._change(
            task_id, lambda task, now: requests.cancel(task, task_id, now, client)
        )
        task = self.repository.find(task_id)
        if task is None or task.state is not TaskState.CANCELING:
            return response
        await self._ended_soon(task_id)  # another server halts its robot
        task = self.repository.find(task_id)
        return requests.halted(task, is_over=task.state.is_ended) if task else response

    async def drop(self, task_id: int, *, client: str = "") -> TaskResponse:
        """Cancel a queued or interrupted task without running it."""
        return await self._change(
            task_id, lambda task, now: requests.drop(task, task_id, now, client)
        )

    async def reprioritise(self, task_id: int, priority: int, *, client: str = "") -> TaskResponse:
        """Move a queued task to another priority."""
        return await self._change(
            task_id, lambda task, now: requests.reprioritise(task, task_id, priority, now, client)
        )

    async def requeue(
        self, task_id: int, *, resume: bool = False, client: str = ""
    ) -> TaskResponse:
        """Queue an interrupted, failed or cancelled task again; see `TaskManager.requeue`."""

        def decide(task: Task | None, now: float) -> requests.Decision:
            refusal = partial(self._requeue_refusal, now)
            return requests.requeue(task, task_id, now, client, resume=resume, refusal=refusal)

        return await self._change(task_id, decide)

    async def pause(self, *, robot: str = "") -> TaskResponse:
        """Halt all robots during their tasks and begin no other task; or only one `robot`."""

        def action(state: FleetState, now: float) -> TaskResponse:
            if robot:
                return rules.pause_robot(state, now, robot, True)
            rules.pause(state, True)
            return TaskResponse(True, "The queue is paused")

        is_own = robot in ("", self.name)
        try:
            response = await self.store.transact(action)
        except TaskRpcError as error:  # at least this server's own robot halts
            if not is_own:
                raise
            self._worker.is_held = True
            failure = ""
            with contextlib.suppress(TaskRpcError):  # the robot has halted before it is stored
                failure = await self._worker.pause()
            note = "" if failure else unstored_note(error)
            return commanded(f"Only {self.name} is paused{note}", failure)
        return await self._followed(response) if is_own else response

    async def resume(self, *, robot: str = "") -> TaskResponse:
        """Continue after a pause or a stop of all robots, or of one `robot`.

        Robots that were paused by name stay paused until they are resumed by name.
        """

        def action(state: FleetState, now: float) -> TaskResponse:
            if robot:
                return rules.pause_robot(state, now, robot, False)
            rules.pause(state, False)
            paused = rules.paused_robots(state)
            note = f"; still paused by name: {', '.join(paused)}" if paused else ""
            hint = f" (taskrpc task resume --robot {paused[0]})" if paused else ""
            return TaskResponse(True, f"The queue is resumed{note}{hint}")

        response = await self.store.transact(action)
        if robot not in ("", self.name):
            return response
        if self._worker.is_held:
            self._worker.is_held = False
            return commanded(response.message, await self._worker.resume())
        return await self._followed(response)

    async def stop(self, *, client: str = "", robot: str = "") -> TaskResponse:
        """Halt all robots at once and pause the queue, or halt and pause one `robot`.

        The running tasks end CANCELED.
        """
        reason = by_client(f"{robot} was stopped" if robot else "the robots were stopped", client)
        failure, begun = "", []
        if is_own := robot in ("", self.name):
            # This server's own robot does not wait for the database, and begins no other task.
            self._worker.is_held = True
            begun = [execution.task.task_id] if (execution := self._worker.execution) else []
            failure = await self._worker.halt(reason, client)

        def action(state: FleetState, now: float) -> tuple[TaskResponse, list[int]]:
            halted = rules.executed_by(state, robot)
            if robot:
                return rules.stop_robot(state, now, robot, reason, client), halted
            rules.stop(state, now, reason, client)
            return TaskResponse(True, "The robots are stopped and the queue is paused"), halted

        try:
            response, halted = await self.store.transact(action)
        except TaskRpcError as error:
            if not is_own:
                raise
            problem = f"only {self.name} was stopped{unstored_note(error)}"
            return TaskResponse(False, f"{failure}; {problem}" if failure else problem)
        if is_own:
            self._worker.is_held = False  # now the database holds it
        if failure:
            return commanded(f"{robot} is paused" if robot else "The queue is paused", failure)
        if robot and halted:
            await self._ended_soon(halted[0])
        return self._with_stopped(response, [*begun, *halted])

    # Internals

    async def _change(
        self, task_id: int, decide: Callable[[Task | None, float], requests.Decision]
    ) -> TaskResponse:
        """Let a rule decide about a task in a transaction; returns the response."""

        def action(state: FleetState, now: float) -> TaskResponse:
            decision = decide(state.tasks.get(task_id), now)
            return rules.carry_out(state, now, decision, partial(self._estimate_in, state, now))

        return await self.store.transact(action)

    def _requeue_refusal(self, now: float, task: Task) -> str:
        state = self.store.state
        unable = self._own_robot.refusal(state, now, task.task_type, task.target)
        return requests.refusal(unable, task.priority, state, self._settings.queue_limit)

    async def _followed(self, response: TaskResponse) -> TaskResponse:
        """Return the response to a pause or a resume once this server's robot has followed it."""
        failure = await self._worker.followed()
        return commanded(response.message, failure) if response.success else response

    def _with_stopped(self, response: TaskResponse, task_ids: Sequence[int]) -> TaskResponse:
        """Return the response to a stop with what has become of the tasks that ran."""
        found = (self.repository.find(task_id) for task_id in dict.fromkeys(task_ids))
        note = stopped_note([task for task in found if task is not None])
        return msgspec.structs.replace(response, message=response.message + note)

    async def _ended_soon(self, task_id: int) -> None:
        deadline = self.store.now() + _FOLLOW_CANCEL
        while (left := deadline - self.store.now()) > 0:
            task = self.repository.find(task_id)
            if task is None or task.state.is_ended:
                return
            await self.change_feed.wait_for_change(self.change_feed.revision, left)

    def _present_plan(self) -> FleetPlan:
        state, now = self.store.state, self.store.now()
        if self._plan is not None:
            version, plan = self._plan
            if version == state.plan_version and now - plan.made_at < _PLAN_AGE:
                return plan
        plan = rules.planned(state, now, self._own_robot.plan, self.name)
        self._plan = state.plan_version, plan
        return plan

    def _estimate_in(self, state: FleetState, now: float, task: Task) -> float:
        """Return the robot seconds to the end of a task that is being queued."""
        plan = self._plan[1] if self._plan is not None else None
        is_far = state.position(task) >= HORIZON
        if plan is None or now - plan.made_at >= _PLAN_AGE or not is_far:
            plan = self._present_plan()
        return max(0.0, self._seconds_to(task, plan)) * self.speed

    def _seconds_to(self, task: Task, plan: FleetPlan) -> float:
        return self._seconds_until(rules.end_of(self.store.state, plan, task))

    def _seconds_until(self, end: Planned | float | None) -> float:
        if end is None:
            return 0.0
        return (end.ends if isinstance(end, Planned) else end) - self.store.now()
