"""The worker of a fleet's server: claims the tasks that the plan gives to its robot."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Coroutine
from typing import Any

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.fleet import rules
from taskrpc.robot.fleet.lease import LeaseKeeper
from taskrpc.robot.fleet.plan import Planner
from taskrpc.robot.fleet.records import FleetRecords
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.fleet.store import FleetStore
from taskrpc.robot.protocol import Plan
from taskrpc.robot.tasks.model import EstimateChange, Task, TaskState
from taskrpc.robot.tasks.responses import SERVER_ENDED
from taskrpc.robot.tasks.robot_guard import RobotGuard
from taskrpc.robot.tasks.task_execution import TaskExecution

log = logging.getLogger("taskrpc.fleet")

_HALT_TIMEOUT = 1.0  # real seconds that a robot may take to end a halted execution
_LOOK_AGAIN = 1.0  # seconds after which an idle robot looks for a task without a notification
_NOTEWORTHY = 0.05  # robot seconds; smaller changes of an estimate are not listed
_PLAN_CHANGED = "the fleet's plan has changed"
_LEASE_ENDED = "the server could not renew its lease, so it halted the robot"


class FleetWorker:
    """Executes tasks of the fleet, one at a time, from `start` until `close`.

    Args:
        name: this server's robot.
        robot_guard: the robot itself.
        store: the fleet's store.
        records: stores the changes of the robot's task.
        lease: the robot's lease.
        planner: see `Planner`.
        refusal: returns why the robot refuses a task type and target for ever, "" if it does not.
        settle: seconds that an idle robot waits for more tasks before it claims one.
    """

    def __init__(
        self,
        name: str,
        robot_guard: RobotGuard,
        store: FleetStore,
        records: FleetRecords,
        lease: LeaseKeeper,
        planner: Planner,
        refusal: rules.Refusal,
        *,
        settle: float,
    ) -> None:
        self._name = name
        self._robot_guard = robot_guard
        self._store = store
        self._records = records
        self._lease = lease
        self._planner = planner
        self._refusal = refusal
        self._settle = settle
        self.is_held = False
        """Whether this robot begins no task, whatever the database says about a pause."""
        self._wake = asyncio.Event()
        self._is_paused = False
        self._halts = 0, 0
        """How often all robots, and this robot, had to halt."""
        self._working: asyncio.Task[None] | None = None
        self._following: dict[asyncio.Task[object], None] = {}

    @property
    def execution(self) -> TaskExecution | None:
        """The execution of the running task; None while the robot is idle."""
        return self._records.execution

    def start(self) -> None:
        """Begin to claim tasks."""
        self._halts, self._is_paused, _ = self._orders()
        self._working = asyncio.create_task(self._work(), name=f"taskrpc worker of {self._name}")

    async def close(self) -> None:
        """Halt the robot and end; the running task is stored as INTERRUPTED."""
        if self._working is None:
            return
        self._working.cancel()
        if execution := self.execution:
            execution.interrupt(SERVER_ENDED)
            try:
                async with asyncio.timeout(_HALT_TIMEOUT):
                    await execution.wait()
            except TimeoutError:
                execution.abandon()
        await asyncio.wait({self._working})
        for following in self._following:
            following.cancel()
        self._records.execution = None

    def look(self) -> None:
        """React to a change of the fleet's records."""
        if self._working is None:
            return  # it has not started yet
        halts, is_paused, reason = self._orders()
        if halts != self._halts:
            self._halts, self._is_paused = halts, is_paused
            self._follow_soon(self.halt(reason))
        elif is_paused != self._is_paused:
            self._is_paused = is_paused
            self._follow_soon(self.pause() if is_paused else self.resume())
        if execution := self.execution:
            self._compare(execution)
        self._wake.set()

    def _orders(self) -> tuple[tuple[int, int], bool, str]:
        """Return the halts, whether the robot is paused, and the reason of the last halt."""
        meta, robot = self._store.state.meta, self._store.state.robots.get(self._name)
        if robot is None:
            return (meta.halts, 0), meta.paused, meta.halt_reason
        reason = robot.halt_reason if robot.halts != self._halts[1] else meta.halt_reason
        return (meta.halts, robot.halts), meta.paused or robot.paused, reason

    def _compare(self, execution: TaskExecution) -> None:
        """Halt an execution that another server has cancelled or interrupted."""
        stored = self._store.state.tasks.get(execution.task.task_id)
        if stored is None or stored.robot != self._name or stored.state.is_ended:
            if not execution.task.state.is_ended:
                execution.interrupt(_LEASE_ENDED)
        elif stored.state is TaskState.CANCELING and execution.task.state in (
            TaskState.RUNNING,
            TaskState.PAUSED,
        ):
            self._follow_soon(execution.cancel(stored.message))

    def lease_ended(self) -> None:
        """Halt the robot: another server may take its tasks over."""
        if execution := self.execution:
            log.error("the robot halts during task %d: %s", execution.task.task_id, _LEASE_ENDED)
            execution.interrupt(_LEASE_ENDED)

    async def halt(self, reason: str, client: str | None = None) -> str:
        """Halt the robot at once; the running task ends CANCELED. Returns why the robot failed.

        `client` has decided this; None if the decision is stored already.
        """
        if (execution := self.execution) is None:
            return self._robot_guard.command(self._robot_guard.robot.stop)
        failure = execution.stop(reason, client)
        has_ended = await self._ends_soon(execution)
        return failure or ("" if has_ended else "the robot does not end its task")

    async def cancel(self, execution: TaskExecution, message: str, client: str) -> bool:
        """Cancel the running task; returns whether it has ended already."""
        await execution.cancel(message, client)
        return await self._ends_soon(execution)

    async def _ends_soon(self, execution: TaskExecution) -> bool:
        """Wait for the end of a halted execution; returns whether it ended in time."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_HALT_TIMEOUT):
                await execution.is_over.wait()
        return execution.is_over.is_set()

    async def pause(self) -> str:
        """Halt the robot during its task; returns why the robot failed, "" if it did not."""
        return await self.execution.pause() if self.execution else ""

    async def resume(self) -> str:
        """Undo `pause`; returns why the robot failed, "" if it did not."""
        if self.execution:
            return await self.execution.resume()
        return self._robot_guard.command(self._robot_guard.robot.resume)

    async def followed(self) -> str:
        """Wait for the robot to follow what `look` has seen, for a second at most.

        Returns why the robot failed, "" if it did not.
        """
        if not self._following:
            return ""
        done, _ = await asyncio.wait([*self._following], timeout=_HALT_TIMEOUT)
        results = [each.result() for each in done if not (each.cancelled() or each.exception())]
        return next((each for each in results if isinstance(each, str) and each), "")

    def _follow_soon(self, work: Coroutine[Any, Any, object]) -> None:
        following = asyncio.create_task(work)
        self._following[following] = None
        following.add_done_callback(self._followed)

    def _followed(self, following: asyncio.Task[object]) -> None:
        del self._following[following]
        if not following.cancelled() and (error := following.exception()) is not None:
            log.error("the robot did not follow a pause, resume or stop: %s", error)

    # The work

    async def _work(self) -> None:
        while True:
            self._wake.clear()
            may_claim = self._lease.is_valid and not self.is_held
            claimed = await self._claimed() if may_claim else None
            if claimed is None:
                await self._woken()
                if self._settle and len(self._store.state):
                    await asyncio.sleep(self._settle)
                continue
            try:
                await self._execute(*claimed)
            except rules.Fenced as fenced:
                log.error("the end of task %d is not stored: %s", claimed[0].task_id, fenced)
            except TaskRpcError as error:
                log.error("task %d: %s", claimed[0].task_id, error)
            except Exception:
                log.exception("the task server itself failed")
                await asyncio.sleep(_LOOK_AGAIN)
            finally:
                self._records.execution = None

    async def _woken(self) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_LOOK_AGAIN):
                await self._wake.wait()

    async def _claimed(self) -> tuple[Task, Plan] | None:
        """Claim the next task of this robot; None if there is none, or the claim failed."""
        name, epoch, store = self._name, self._lease.epoch, self._store
        if not rules.may_claim(store.state, store.now(), name, self._planner, self._refusal):
            return None

        def action(state: FleetState, now: float) -> tuple[Task, Plan] | None:
            return rules.claim(state, now, name, epoch, self._planner, self._refusal)

        try:
            return await store.transact(action)
        except TaskRpcError as error:
            # If this claim was committed all the same, the next claim puts its task back.
            log.warning("%s cannot claim a task: %s", name, error)
            return None

    async def _execute(self, task: Task, plan: Plan) -> None:
        if not self._lease.is_valid:
            # This process was paused between the claim and its answer. The next claim puts the
            # task back, or another server has interrupted it.
            return
        queued = msgspec.structs.replace(task, state=TaskState.QUEUED, robot="", started_at=None)
        execution = TaskExecution(
            self._robot_guard, self._records, queued, plan.seconds, self._store.now
        )
        self._records.execution = execution
        await execution.begin()
        self.look()  # whatever came between the claim and the beginning
        await execution.wait()
        await execution.end(self._changes(task))

    def _changes(self, task: Task) -> tuple[EstimateChange, ...]:
        """Return by how much the task ends later than its accepted estimate."""
        took = (self._store.now() - task.submitted_at) * self._robot_guard.speed
        late = took - task.accepted_estimate
        return () if abs(late) < _NOTEWORTHY else (EstimateChange(late, _PLAN_CHANGED),)
