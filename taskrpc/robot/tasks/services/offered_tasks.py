"""Offers the tasks of a robot or of a fleet as services of a node."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Collection, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeAlias, TypeVar

import srvgen
from taskrpc import current_call
from taskrpc.errors import (
    Code,
    HandlerError,
    NameInUse,
    OutcomeUnknown,
    StoreError,
    TaskRpcError,
    text_for_callers,
)
from taskrpc.node import Node
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.responses import Resumed, TaskMessages, TaskResponse
from taskrpc.robot.tasks.services.action import SubmittingTasks, TaskAction
from taskrpc.robot.tasks.services.pages import page
from taskrpc.robot.tasks.services.permissions import (
    ROLES,
    client_name,
    refuse_others_task,
    submitter,
)
from taskrpc.robot.tasks.services.topics import TaskTopics
from taskrpc.service import Service
from taskrpc.spi import Completion, CompletionStore, IntrospectionState

if TYPE_CHECKING:
    from srvgen.stubs.my_robot_interfaces.srv import RobotTask
    from srvgen.stubs.std_srvs.srv import Trigger
    from srvgen.stubs.taskrpc_interfaces.msg import TaskInfo
    from srvgen.stubs.taskrpc_interfaces.srv import (
        CancelTask,
        DropTask,
        EstimateTask,
        ListTasks,
        PauseTasks,
        ReprioritiseTask,
        RequeueTask,
        ResumeTasks,
        ShowTask,
        StopRobot,
        WatchTasks,
    )

_log = logging.getLogger("taskrpc.tasks")

_CONCURRENCY = 64  # calls of one service that may wait for the disk at the same time
_WATCHERS = 1000
_WATCH_SECONDS = 10.0  # how long a watcher without a timeout waits
_WATCH_AT_MOST = 60.0
_WATCH_SHARE = 0.9  # of the call's time left; the rest is for sending the response
_WATCHED_TASKS = 100  # with more changes the response is incomplete: the client lists them

_TYPES = {
    "submit": "my_robot_interfaces/srv/RobotTask",
    "estimate": "taskrpc_interfaces/srv/EstimateTask",
    "list": "taskrpc_interfaces/srv/ListTasks",
    "show": "taskrpc_interfaces/srv/ShowTask",
    "watch": "taskrpc_interfaces/srv/WatchTasks",
    "cancel": "taskrpc_interfaces/srv/CancelTask",
    "pause": "taskrpc_interfaces/srv/PauseTasks",
    "resume": "taskrpc_interfaces/srv/ResumeTasks",
    "reprioritise": "taskrpc_interfaces/srv/ReprioritiseTask",
    "requeue": "taskrpc_interfaces/srv/RequeueTask",
    "drop": "taskrpc_interfaces/srv/DropTask",
    "stop": "taskrpc_interfaces/srv/StopRobot",
    "health": "std_srvs/srv/Trigger",
}
"""The type of each service."""

_Handler: TypeAlias = Callable[[Any, Any], Awaitable[Any]]


class _Outcome(Protocol):
    """What the response to every request that changes tasks has."""

    success: bool
    message: str


_Filled = TypeVar("_Filled", bound=_Outcome)


def load_types() -> dict[str, Any]:
    """Load the types of all services; this takes most of a task server's start time."""
    return {verb: srvgen.load(name) for verb, name in _TYPES.items()}


class OfferedTasks:
    """The services of a task manager; `TaskServer` and `FleetServer` are servers.

    Args:
        node: a started node; `close` does not close it.
        manager: the tasks.
        completions: keeps the completed submissions, together with the tasks.
        names: the names of the service that accepts tasks, the main one first; all further
            services are below each of them.
        join: the names that other servers may offer too.
        topics: the name below which the topics are.
        introspection: what the services publish about their calls; see
            `Node.configure_introspection`.
    """

    def __init__(
        self,
        node: Node,
        manager: SubmittingTasks,
        completions: CompletionStore,
        *,
        names: Sequence[str],
        join: Collection[str],
        topics: str,
        introspection: IntrospectionState,
    ) -> None:
        self.manager = manager
        """The tasks; for programs that work with them without a network."""
        self._completions = completions
        self._node = node
        self._names = names
        self._join = join
        self._topics_name = topics
        self._introspection = introspection
        self._messages = TaskMessages()
        self._types = load_types()
        self._services: list[Service] = []
        self._topics: TaskTopics | None = None
        self._action: TaskAction | None = None
        self._started = asyncio.Event()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        await self.close()

    async def start(self, *, fresh: bool = False) -> Resumed:
        """Offer the services, queue the earlier server's tasks again and start the robot.

        With `fresh` the tasks of the earlier server are forgotten instead. Returns the resumed
        tasks; the `str` of that is a sentence for the user.

        Raises:
            StoreError: the store cannot be used.
            NameInUse: another server offers the service.
        """
        # Offer the services first: a second server must not touch the store of the server that
        # has the name. Calls that arrive before the store is read wait for it.
        try:
            for name in self._names:
                self._offer(name, join=name in self._join)
            self._topics = TaskTopics(self._node, self.manager, self._messages, self._topics_name)
            self._offer_action()
            if fresh:
                await self._forget_all()
            resumed = await self.manager.start()
        except BaseException:
            for service in self._services:
                service.destroy()
            self._services.clear()
            self._close_topics()
            self._close_action()
            raise
        self._started.set()
        self._opened()
        return resumed

    def _offer_action(self) -> None:
        """Offer the tasks as an action, unless a server that this one joins offers it.

        Its goals live in this process: in a fleet, the action has the name of the robot.
        """
        try:
            self._action = TaskAction(self._node, self.manager, self._topics_name, self._started)
        except NameInUse:
            if not self._join:
                raise
            _log.info("another server of this name offers the action; this one only the services")

    async def _forget_all(self) -> None:
        """Forget the tasks of earlier servers. Raises StoreError."""
        raise NotImplementedError

    def _opened(self) -> None:
        """Take notice that the store has been read."""

    async def health(self) -> TaskResponse:
        """Return whether the server accepts tasks: `success`, and why not in `message`."""
        if not self._started.is_set():
            return TaskResponse(
                False, "not ready: starting, reading the tasks of the earlier server"
            )
        if self.manager.change_feed.is_closed:
            return TaskResponse(False, "not ready: ending")
        if problem := await self.manager.repository.problem():
            return TaskResponse(False, f"not ready: {problem}")
        return TaskResponse(True, f"ready: {self.manager}")

    def dismiss_watchers(self) -> None:
        """Respond to all watchers, so that the node can drain without waiting for them.

        The goals of the action end too; their tasks stay.
        """
        self.manager.change_feed.close()
        self._close_action()

    async def close(self) -> None:
        """Halt the robot, store the running task as INTERRUPTED and close the store."""
        self._close_topics()
        await self.manager.close()
        self._close_action()

    def _close_topics(self) -> None:
        if self._topics is not None:
            self._topics.close()
            self._topics = None

    def _close_action(self) -> None:
        if self._action is not None:
            self._action.close()
            self._action = None

    def _offer(self, name: str, *, join: bool) -> None:
        submit = self._node.create_service(
            self._types["submit"],
            name,
            self._submitted,
            exactly_once=self._completions,
            join=join,
        )
        self._services.append(submit)
        # A client may repeat a call that reads or halts when its response was lost. It must not
        # repeat a call that starts something: another client may have halted it meanwhile.
        handlers: tuple[tuple[str, _Handler, bool], ...] = (
            ("estimate", self.estimate, True),
            ("list", self.list_tasks, True),
            ("show", self.show, True),
            ("watch", self.watch, True),
            ("cancel", self.cancel, True),
            ("pause", self.pause, True),
            ("resume", self.resume, False),
            ("reprioritise", self.reprioritise, False),
            ("requeue", self.requeue, False),
            ("drop", self.drop, True),
            ("stop", self.stop, True),
        )
        for verb, handler, may_repeat in handlers:
            service = self._node.create_service(
                self._types[verb],
                f"{name}/{verb}",
                self._guarded(handler),
                concurrency=_WATCHERS if verb == "watch" else _CONCURRENCY,
                idempotent=may_repeat,
                join=join,
                role=ROLES[verb],
            )
            self._services.append(service)
        health = self._node.create_service(
            self._types["health"],
            f"{name}/health",
            self.tell_health,  # unguarded: it reports why the other services wait
            concurrency=_CONCURRENCY,
            idempotent=True,
            join=join,
            role=ROLES["health"],
        )
        self._services.append(health)
        if self._introspection != "off":
            for service in self._services:
                self._node.configure_introspection(service, self._introspection)

    def _guarded(self, handler: _Handler) -> _Handler:
        """Return the handler with errors for a server that ends and a store that fails."""

        @wraps(handler)
        async def guarded(request: Any, response: Any) -> Any:
            if not self._started.is_set():
                await self._started.wait()
            self._refuse_when_closed()
            try:
                return await handler(request, response)
            except (StoreError, OutcomeUnknown) as error:
                raise failed_call(Code.INTERNAL, error) from error

        return guarded

    def _refuse_when_closed(self) -> None:
        if self.manager.is_closed:  # so is the store; nothing was done
            raise HandlerError(Code.UNAVAILABLE, "the task server is ending")

    # The handlers: `request` and `response` are messages of the service's type

    async def submit(
        self, request: RobotTask.Request, response: RobotTask.Response
    ) -> RobotTask.Response:
        """Queue a task; see RobotTask.srv."""
        raise NotImplementedError

    def _submitted(
        self, request: RobotTask.Request, response: RobotTask.Response
    ) -> RobotTask.Response | Awaitable[RobotTask.Response]:
        """Take a call of the service that accepts tasks."""
        return self._guarded(self.submit)(request, response)

    async def estimate(
        self, request: EstimateTask.Request, response: EstimateTask.Response
    ) -> EstimateTask.Response:
        """Say when a task would end, without queueing it; see EstimateTask.srv."""
        _, account, machine = submitter()
        result = self.manager.preview(
            request.task_type, request.target, request.priority, account=account, machine=machine
        )
        return filled(response, result)

    async def list_tasks(
        self, request: ListTasks.Request, response: ListTasks.Response
    ) -> ListTasks.Response:
        """List tasks in the order of execution; see ListTasks.srv."""
        response.revision = self.manager.change_feed.revision
        try:
            found = page(self.manager, request.page, limit=request.limit, ended=request.all)
        except ValueError as error:
            raise HandlerError(Code.INVALID_ARGUMENT, str(error)) from None
        response.tasks = [self._info(row.task, row.estimated_time) for row in found.rows]
        response.next_page = found.next_page
        response.queued = len(self.manager.queue)
        response.paused = self.manager.is_paused
        return response

    async def show(
        self, request: ShowTask.Request, response: ShowTask.Response
    ) -> ShowTask.Response:
        """Show one task; see ShowTask.srv."""
        task = self.manager.repository.find(request.task_id)
        response.success = task is not None
        if task is None:
            response.message = f"There is no task {request.task_id}"
            return response
        self.manager.update_estimates()
        response.task = self._messages.whole_task_info(
            task,
            self.manager.estimate(task.task_id),
            self.manager.changes(task),
            self.manager.planned_robot(task),
            self.manager.waits_for(task),
        )
        return response

    async def watch(
        self, request: WatchTasks.Request, response: WatchTasks.Response
    ) -> WatchTasks.Response:
        """Wait for changes; see WatchTasks.srv."""
        feed, only = self.manager.change_feed, request.task_id
        response.success = not only or self.manager.repository.find(only) is not None
        if not response.success:
            response.message = f"There is no task {only}"
            return response
        await feed.wait_for_change(request.revision, _watch_timeout(request.timeout), task_id=only)
        changed = feed.changed_since(request.revision)
        response.complete = changed is not None and len(changed) <= _WATCHED_TASKS
        if only and (changed is None or only in changed):
            response.complete, changed = True, [only]
        elif only:
            changed = []
        response.revision = feed.revision
        response.paused = self.manager.is_paused
        if response.complete and changed:
            self._fill(response, changed)
        return response

    async def cancel(
        self, request: CancelTask.Request, response: CancelTask.Response
    ) -> CancelTask.Response:
        """Cancel a task; see CancelTask.srv."""
        refuse_others_task(self.manager.repository.find(request.task_id))
        return filled(response, await self.manager.cancel(request.task_id, client=client_name()))

    async def pause(
        self, request: PauseTasks.Request, response: PauseTasks.Response
    ) -> PauseTasks.Response:
        """Halt the robot and pause the queue; see PauseTasks.srv."""
        return filled(response, await self.manager.pause(robot=request.robot))

    async def resume(
        self, request: ResumeTasks.Request, response: ResumeTasks.Response
    ) -> ResumeTasks.Response:
        """Continue after a pause; see ResumeTasks.srv."""
        return filled(response, await self.manager.resume(robot=request.robot))

    async def reprioritise(
        self, request: ReprioritiseTask.Request, response: ReprioritiseTask.Response
    ) -> ReprioritiseTask.Response:
        """Change a task's priority; see ReprioritiseTask.srv."""
        priority, client = request.priority, client_name()
        result = await self.manager.reprioritise(request.task_id, priority, client=client)
        return filled(response, result)

    async def requeue(
        self, request: RequeueTask.Request, response: RequeueTask.Response
    ) -> RequeueTask.Response:
        """Queue an ended task again; see RequeueTask.srv."""
        resume, client = request.resume, client_name()
        result = await self.manager.requeue(request.task_id, resume=resume, client=client)
        return filled(response, result)

    async def drop(
        self, request: DropTask.Request, response: DropTask.Response
    ) -> DropTask.Response:
        """Cancel a queued or interrupted task; see DropTask.srv."""
        refuse_others_task(self.manager.repository.find(request.task_id))
        return filled(response, await self.manager.drop(request.task_id, client=client_name()))

    async def stop(
        self, request: StopRobot.Request, response: StopRobot.Response
    ) -> StopRobot.Response:
        """Halt the robot at once and pause the queue; see StopRobot.srv."""
        result = await self.manager.stop(client=client_name(), robot=request.robot)
        return filled(response, result)

    async def tell_health(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Report whether the server accepts tasks now; a std_srvs/srv/Trigger."""
        return filled(response, await self.health())

    def _fill(self, response: WatchTasks.Response, changed: list[int]) -> None:
        self.manager.update_estimates()
        found = (self.manager.repository.find(task_id) for task_id in changed)
        response.tasks = [
            self._info(task, self.manager.estimate(task.task_id))
            for task in found
            if task is not None
        ]

    def _info(self, task: Task, estimated_time: float) -> TaskInfo:
        manager = self.manager
        return self._messages.task_info(
            task, estimated_time, manager.planned_robot(task), manager.waits_for(task)
        )


def failed_call(unstored: Code, error: TaskRpcError) -> HandlerError:
    """Return the error for the caller when the store failed; the log gets the full text."""
    _log.error("%s", error)
    code = Code.OUTCOME_UNKNOWN if isinstance(error, OutcomeUnknown) else unstored
    return HandlerError(code, text_for_callers(error))


def filled(response: _Filled, result: TaskResponse) -> _Filled:
    """Return the response message, filled with the manager's result."""
    response.success = result.success
    response.message = result.message
    if hasattr(response, "task_id"):
        response.task_id = result.task_id
    if hasattr(response, "estimated_time"):
        response.estimated_time = result.estimated_time
    return response


def completed(response: Any) -> Completion | None:
    """Return the completion of the running call, None outside a call."""
    try:
        return current_call().completed_by(response)
    except LookupError:  # a handler was called directly
        return None


def nothing_done() -> None:
    """Declare that the running call was refused."""
    with contextlib.suppress(LookupError):  # a handler was called directly
        current_call().nothing_done()


def _watch_timeout(requested: float) -> float:
    """Return how many seconds a watcher may wait to get its response before its deadline."""
    timeout = min(requested if requested > 0 else _WATCH_SECONDS, _WATCH_AT_MOST)
    try:
        left = current_call().time_left()
    except LookupError:
        left = None
    return timeout if left is None else min(timeout, left * _WATCH_SHARE)
