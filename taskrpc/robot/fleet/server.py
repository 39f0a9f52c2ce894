"""The server of a fleet: offers a fleet's tasks as services of a node."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from taskrpc import current_call
from taskrpc.errors import Code, NameInUse, OutcomeUnknown, StoreError
from taskrpc.node import Node
from taskrpc.robot.fleet.manager import FleetManager, FleetSettings
from taskrpc.robot.fleet.store import AlreadyCompleted, FleetStore
from taskrpc.robot.protocol import Robot
from taskrpc.robot.tasks.responses import Resumed, TaskResponse
from taskrpc.robot.tasks.services.offered_tasks import (
    OfferedTasks,
    completed,
    failed_call,
    filled,
    nothing_done,
)
from taskrpc.robot.tasks.services.permissions import submitter
from taskrpc.spi import ClientKey, Completion, Execution, IntrospectionState, StoredCompletions

if TYPE_CHECKING:
    from srvgen.stubs.my_robot_interfaces.srv import RobotTask
    from srvgen.stubs.taskrpc_interfaces.srv import EstimateTask, ListTasks, ShowTask, WatchTasks


class FleetServer(OfferedTasks):
    """Offers the tasks of a fleet as `/robot_task`, and drives one robot of the fleet.

    All servers of the fleet offer the same name, so a client calls any of them. Each also offers
    the same services below its robot's name, such as `/robot_1/robot_task`.

    Args:
        node: a started node; `close` does not close it.
        robot: this server's robot, an object that follows the `Robot` protocol.
        store: the fleet's store; `close` closes it.
        settings: see `FleetSettings`.
        service_name: the name that all servers of the fleet offer.
        introspection: what the services publish about their calls; see
            `Node.configure_introspection`.
    """

    def __init__(
        self,
        node: Node,
        robot: Robot,
        store: FleetStore,
        settings: FleetSettings | None = None,
        *,
        service_name: str = "robot_task",
        introspection: IntrospectionState = "off",
    ) -> None:
        manager = FleetManager(robot, store, settings)
        manager.address = lambda: node.address  # known once the services are offered
        own_name = f"{manager.name}/{service_name}"
        super().__init__(
            node,
            manager,
            FleetCompletions(store),
            names=[service_name, own_name],
            join=[service_name],
            topics=own_name,
            introspection=introspection,
        )
        self.manager: FleetManager = manager
        self._store = store

    async def start(self, *, fresh: bool = False) -> Resumed:
        """Offer the services, join the fleet and let the robot begin.

        With `fresh` all tasks of the fleet are forgotten; no other server may run.

        Raises:
            NameTaken: another server drives a robot of this name.
            StoreError: the database cannot be used.
            NameInUse: another server on this machine offers a service of this robot's name.
        """
        try:
            await self._store.store_id()  # before a service is offered
            return await super().start(fresh=fresh)
        except NameInUse as error:
            await self._store.close()
            what, _, _ = str(error).partition(";")
            advice = "give each robot of a fleet a name of its own with --robot-name"
            raise NameInUse(f"{what}; {advice}") from None
        except BaseException:
            await self._store.close()
            raise

    async def _forget_all(self) -> None:
        await self._store.clear()

    async def submit(
        self, request: RobotTask.Request, response: RobotTask.Response
    ) -> RobotTask.Response:
        """Queue a task; see RobotTask.srv."""
        client, account, machine = submitter()
        execution = _execution()
        received = None if execution is None else execution.received_id
        key = None
        if execution is not None and received is not None:
            key = execution.principal, received.client, received.sequence
        try:
            result = await self.manager.submit(
                request.task_type,
                request.target,
                request.priority,
                client=client,
                account=account,
                machine=machine,
                completing=lambda result: completed(filled(response, result)),
                request=key,
            )
        except AlreadyCompleted as already:
            assert execution is not None, "only an execution has a request key"
            stored: RobotTask.Response = execution.completed_elsewhere(already.completion)
            return stored
        except (StoreError, OutcomeUnknown) as error:
            raise failed_call(Code.UNAVAILABLE, error) from error
        if not result.success:
            nothing_done()
        return filled(response, result)

    # A client may have changed the tasks at another server just before it asks this one.

    async def estimate(
        self, request: EstimateTask.Request, response: EstimateTask.Response
    ) -> EstimateTask.Response:
        """Say when a task would end, without queueing it; see EstimateTask.srv."""
        await self.manager.repository.refreshed()
        return await super().estimate(request, response)

    async def list_tasks(
        self, request: ListTasks.Request, response: ListTasks.Response
    ) -> ListTasks.Response:
        """List tasks in the order of execution; see ListTasks.srv."""
        await self.manager.repository.refreshed()
        return await super().list_tasks(request, response)

    async def show(
        self, request: ShowTask.Request, response: ShowTask.Response
    ) -> ShowTask.Response:
        """Show one task; see ShowTask.srv."""
        await self.manager.repository.refreshed()
        return await super().show(request, response)

    async def watch(
        self, request: WatchTasks.Request, response: WatchTasks.Response
    ) -> WatchTasks.Response:
        """Wait for changes; see WatchTasks.srv."""
        await self.manager.repository.refreshed()
        return await super().watch(request, response)

    async def health(self) -> TaskResponse:
        """Return whether the server accepts tasks: `success`, and why not in `message`."""
        found = await super().health()
        if found.success and not self.manager.lease.is_valid:
            return TaskResponse(False, f"not ready: {self.manager.name} has no lease now")
        return found


class FleetCompletions:
    """A `SharedCompletionStore` that keeps completed requests in the fleet's database."""

    def __init__(self, store: FleetStore) -> None:
        self._store = store

    async def recall(self) -> StoredCompletions:
        """Return the database's id; completions are looked up one client at a time."""
        return StoredCompletions(await self._store.store_id())

    async def look_up(self, client: ClientKey) -> Sequence[Completion]:
        """Return the completions of a client. Raises StoreError."""
        return await self._store.look_up(client)

    async def complete(
        self, completion: Completion | None, effect: Any, forgotten: Sequence[ClientKey] = ()
    ) -> None:
        """Store a completion without a task."""
        assert effect is None, "handlers store their tasks themselves, with the completion"
        if completion is None:
            # Another server may have heard of these clients since: the database knows.
            await self._store.forget_old_clients()
            return
        key = completion.principal, completion.client, completion.sequence
        await self._store.transact(lambda state, now: state.complete(completion), key)


def _execution() -> Execution | None:
    with contextlib.suppress(LookupError):  # a method was called directly
        call = current_call()
        if isinstance(call, Execution):
            return call
    return None
