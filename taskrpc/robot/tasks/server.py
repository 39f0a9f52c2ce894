"""The task server: offers the tasks of one robot."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from typing import TYPE_CHECKING

from taskrpc.errors import Code, OutcomeUnknown, StoreError
from taskrpc.node import Node
from taskrpc.robot.protocol import Robot
from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.queue.journal import QueueJournal
from taskrpc.robot.tasks.records.repository import TaskCompletions
from taskrpc.robot.tasks.records.store import TaskStore
from taskrpc.robot.tasks.responses import Resumed
from taskrpc.robot.tasks.services.offered_tasks import (
    OfferedTasks,
    completed,
    failed_call,
    filled,
    nothing_done,
)
from taskrpc.robot.tasks.services.permissions import submitter
from taskrpc.spi import FileInUse, IntrospectionState, time_of_day

if TYPE_CHECKING:
    from srvgen.stubs.my_robot_interfaces.srv import RobotTask


class TaskServer(OfferedTasks):
    """Offers a robot's task queue as `/robot_task` and the services below it.

    Use it as `async with TaskServer(node, robot, store):`, or call `start` and `close`.

    Args:
        node: a started node; `close` does not close it.
        robot: the robot, an object that follows the `Robot` protocol.
        store: keeps the tasks for the next server; `close` closes it.
        service_name: the name of the service that accepts tasks.
        join: whether to start although another server offers the same service.
        introspection: what the services publish about their calls; see
            `Node.configure_introspection`.
        queue_limit, share, settle, wall_clock, journal: see `TaskSettings`.
    """

    def __init__(
        self,
        node: Node,
        robot: Robot,
        store: TaskStore,
        *,
        queue_limit: int = 10_000,
        share: int | None = None,
        settle: float = 0.1,
        service_name: str = "robot_task",
        join: bool = False,
        introspection: IntrospectionState = "off",
        wall_clock: Callable[[], float] = time_of_day,
        journal: QueueJournal | None = None,
    ) -> None:
        settings = TaskSettings(
            queue_limit=queue_limit,
            share=share,
            settle=settle,
            wall_clock=wall_clock,
            journal=journal,
        )
        manager = TaskManager(robot, store, settings)
        completions = TaskCompletions(store, manager.repository)
        super().__init__(
            node,
            manager,
            completions,
            names=[service_name],
            join=[service_name] if join else [],
            topics=service_name,
            introspection=introspection,
        )
        self.manager: TaskManager = manager
        self._store = store
        self._task_completions = completions

    async def start(self, *, fresh: bool = False) -> Resumed:
        """Offer the services and start the robot; see `OfferedTasks.start`."""
        opened = not fresh and self._open_store()
        try:
            return await super().start(fresh=fresh)
        except BaseException:
            if opened:
                await self._store.close()
            raise

    def _open_store(self) -> bool:
        """Open a store with an `open_now`, before a service is offered; return whether it did so.

        Raises StoreError.
        """
        if not hasattr(self._store, "open_now"):
            return False
        try:
            return bool(self._store.open_now())
        except FileInUse:  # the other server may have the services' names too, which says more
            return False

    async def _forget_all(self) -> None:
        await self._store.clear()

    def _opened(self) -> None:
        self._task_completions.opened()

    async def submit(
        self, request: RobotTask.Request, response: RobotTask.Response
    ) -> RobotTask.Response:
        """Queue a task; see RobotTask.srv."""
        begun = self._begin_submit(request, response)
        return await begun if isinstance(begun, asyncio.Future) else begun

    def _submitted(
        self, request: RobotTask.Request, response: RobotTask.Response
    ) -> RobotTask.Response | Awaitable[RobotTask.Response]:
        if self._started.is_set():
            self._refuse_when_closed()
            return self._begin_submit(request, response)
        return self._guarded(self.submit)(request, response)

    def _begin_submit(
        self, request: RobotTask.Request, response: RobotTask.Response
    ) -> RobotTask.Response | asyncio.Future[RobotTask.Response]:
        """Queue a task; returns the response, or its future while the task is being stored."""
        client, account, machine = submitter()
        # A future and no coroutine: the node would make an asyncio task for each waiting coroutine.
        queued: asyncio.Future[RobotTask.Response]
        queued = asyncio.get_running_loop().create_future()
        try:
            result = self.manager.submit_with_callback(
                partial(_resolve_response, queued, response),
                request.task_type,
                request.target,
                request.priority,
                client=client,
                account=account,
                machine=machine,
                completing=lambda result: completed(filled(response, result)),
            )
        except (StoreError, OutcomeUnknown) as error:
            raise failed_call(Code.UNAVAILABLE, error) from error
        if result.success:
            return queued
        nothing_done()
        return filled(response, result)


def _resolve_response(
    queued: asyncio.Future[RobotTask.Response],
    response: RobotTask.Response,
    error: BaseException | None,
) -> None:
    """Resolve the future of a filled response when its task is stored, or is not."""
    if queued.done():
        return  # the call was cancelled
    if error is None:
        queued.set_result(response)
    elif isinstance(error, StoreError | OutcomeUnknown):
        queued.set_exception(failed_call(Code.UNAVAILABLE, error))  # not done, or outcome unknown
    elif isinstance(error, asyncio.CancelledError):
        queued.cancel()
    else:
        queued.set_exception(error)
