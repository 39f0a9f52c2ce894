"""The task server: a task manager behind the services of a node."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Awaitable, Callable
from functools import partial, wraps
from types import TracebackType
from typing import Any, Self, TypeAlias

import srvgen
from taskrpc.callinfo import current_call
from taskrpc.errors import Code, HandlerError, OutcomeUnknown, StoreError, TaskRpcError, told
from taskrpc.introspection import IntrospectionState
from taskrpc.node import Node
from taskrpc.request_ids.ids import Completion
from taskrpc.robot.protocol import Robot
from taskrpc.service import Service
from taskrpc.tasks.answers import Answer, Resumed
from taskrpc.tasks.manager import TaskManager
from taskrpc.tasks.messages import Messages
from taskrpc.tasks.model import Task
from taskrpc.tasks.permissions import ROLES, client_name, refuse_others_task, submitter
from taskrpc.tasks.queue.pages import page
from taskrpc.tasks.records.completions import TaskCompletions
from taskrpc.tasks.records.store import TaskStore
from taskrpc.tasks.topics import TaskNews

_log = logging.getLogger("taskrpc.tasks")

_CONCURRENCY = 64  # so many calls of one service may wait for the disk together
_WATCHERS = 1000
_WATCH_SECONDS = 10.0  # how long a watcher that does not say waits
_WATCH_AT_MOST = 60.0
_WATCH_SHARE = 0.9  # of the time that the caller waits; the rest is for the way back
_WATCHED_TASKS = 100  # more changes at once are told as "list them afresh"

_TYPES = {
    "submit": "my_robot_interfaces/srv/RobotTask",
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
"""What each service's requests and answers are."""

_Handler: TypeAlias = Callable[[Any, Any], Awaitable[Any]]


def load_types() -> dict[str, Any]:
    """The types of all services; loading them is most of the work of a task server's start."""
    return {verb: srvgen.load(name) for verb, name in _TYPES.items()}


class TaskServer:
    """Offers a robot's task queue as `/robot_task` and the services below it.

    Use it as `async with TaskServer(node, robot, store):`, or call `start` and `close`.

    Args:
        node: a started node; it stays the caller's.
        robot: the robot, an object that follows the `Robot` protocol.
        store: where tasks survive; `close` closes it.
        queue_limit: how many tasks may wait.
        share: how many of them may be of one account at one machine; None for all.
        settle: real seconds that an idle robot waits for company before it takes the first task.
        service_name: the name of the service that takes tasks.
        keep_ended: how many ended tasks are remembered, besides the interrupted ones.
        join: whether to start although another server has the name.
        introspection: what the services tell of their calls; see `Node.configure_introspection`.
        wall_clock: the time of day, in seconds since 1970.
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
        keep_ended: int = 1000,
        join: bool = False,
        introspection: IntrospectionState = "off",
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self._join = join
        self._introspection = introspection
        self._store = store
        self.manager = TaskManager(
            robot,
            store,
            queue_limit=queue_limit,
            share=share,
            settle=settle,
            keep_ended=keep_ended,
            wall_clock=wall_clock,
        )
        self._completions = TaskCompletions(store, self.manager.book)
        self._node = node
        self._service_name = service_name
        self._messages = Messages()
        self._types = load_types()
        self._services: list[Service] = []
        self._news: TaskNews | None = None
        self._started = asyncio.Event()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def start(self, *, fresh: bool = False) -> Resumed:
        """Take up the tasks of the server before, begin to work and offer the services.

        With `fresh` the tasks of the server before are forgotten instead. Returns what was taken
        up; its `str` is a sentence for the user.

        Raises:
            StoreError: the store cannot be used.
            NameInUse: somebody else offers the service.
        """
        # Offered first: a second server must not touch the store of the one that has the name.
        # Whoever calls before the store is read waits for it.
        try:
            self._offer()
            self._news = TaskNews(self._node, self.manager, self._messages, self._service_name)
            if fresh:
                await self._store.clear()
            resumed = await self.manager.start()
        except BaseException:
            for service in self._services:
                service.destroy()
            self._services.clear()
            self._close_news()
            raise
        self._started.set()
        self._completions.opened()
        return resumed

    async def health(self) -> Answer:
        """Whether tasks are taken now: `success`, and one sentence that says why not."""
        if not self._started.is_set():
            return Answer(False, "not ready: starting, the tasks of earlier runs are being read")
        if self.manager.board.is_closed:
            return Answer(False, "not ready: ending")
        if problem := await self.manager.book.problem():
            return Answer(False, f"not ready: {problem}")
        return Answer(True, f"ready: {self.manager}")

    def dismiss_watchers(self) -> None:
        """Answer everybody who waits for a change, so that a node may drain without them."""
        self.manager.board.close()

    async def close(self) -> None:
        """Halt the robot, store the running task as INTERRUPTED and close the store."""
        self._close_news()
        await self.manager.close()

    def _close_news(self) -> None:
        if self._news is not None:
            self._news.close()
            self._news = None

    def _offer(self) -> None:
        submit = self._node.create_service(
            self._types["submit"],
            self._service_name,
            self._submitted,
            exactly_once=self._completions,
            join=self._join,
        )
        self._services.append(submit)
        # A call that looks or halts may be repeated when its answer is lost. One that sets things
        # going may not: somebody else may have halted them meanwhile.
        for verb, handler, may_repeat in (
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
        ):
            service = self._node.create_service(
                self._types[verb],
                f"{self._service_name}/{verb}",
                self._guarded(handler),
                concurrency=_WATCHERS if verb == "watch" else _CONCURRENCY,
                idempotent=may_repeat,
                join=self._join,
                role=ROLES[verb],
            )
            self._services.append(service)
        health = self._node.create_service(
            self._types["health"],
            f"{self._service_name}/health",
            self.tell_health,  # unguarded: it says what the others wait for
            concurrency=_CONCURRENCY,
            idempotent=True,
            join=self._join,
            role=ROLES["health"],
        )
        self._services.append(health)
        if self._introspection != "off":
            for service in self._services:
                self._node.configure_introspection(service, self._introspection)

    def _guarded(self, handler: _Handler) -> _Handler:
        """The handler, which tells its caller when the server ends or what the store lacks."""

        @wraps(handler)
        async def guarded(request: Any, response: Any) -> Any:
            if not self._started.is_set():
                await self._started.wait()
            self._refuse_at_end()
            try:
                return await handler(request, response)
            except (StoreError, OutcomeUnknown) as error:
                raise _failed(Code.INTERNAL, error) from error

        return guarded

    def _refuse_at_end(self) -> None:
        if self.manager.is_closed:  # the store is, too; and nothing was done
            raise HandlerError(Code.UNAVAILABLE, "the task server is ending")

    # The handlers: `request` and `response` are the service's own messages

    async def submit(self, request: Any, response: Any) -> Any:
        """Queue a task; see RobotTask.srv."""
        answer = self._begin_submit(request, response)
        return await answer if isinstance(answer, asyncio.Future) else answer

    def _submitted(self, request: Any, response: Any) -> Any:
        if self._started.is_set():
            self._refuse_at_end()
            return self._begin_submit(request, response)
        return self._guarded(self.submit)(request, response)

    def _begin_submit(self, request: Any, response: Any) -> Any:
        """Queue a task; returns the response, or a future of it while the task is being stored."""
        client, account, machine = submitter()
        # No coroutine: for each that waits for the disk a task would be made.
        queued = asyncio.get_running_loop().create_future()
        try:
            answer = self.manager.submit_then(
                partial(_tell_queued, queued, response),
                request.task_type,
                request.target,
                request.priority,
                client=client,
                account=account,
                machine=machine,
                completing=lambda answer: _completed(_answered(response, answer)),
            )
        except (StoreError, OutcomeUnknown) as error:
            raise _failed(Code.UNAVAILABLE, error) from error
        if answer.success:
            return queued
        _nothing_done()
        return _answered(response, answer)

    async def list_tasks(self, request: Any, response: Any) -> Any:
        """List tasks in the order of run; see ListTasks.srv."""
        response.revision = self.manager.board.revision
        try:
            found = page(self.manager, request.page, limit=request.limit, ended=request.all)
        except ValueError as error:
            raise HandlerError(Code.INVALID_ARGUMENT, str(error)) from None
        response.tasks = [
            self._messages.task_info(row.task, row.estimated_time) for row in found.rows
        ]
        response.next_page = found.next_page
        response.queued = len(self.manager.queue)
        response.paused = self.manager.is_paused
        return response

    async def show(self, request: Any, response: Any) -> Any:
        """Show one task; see ShowTask.srv."""
        task = self.manager.book.find(request.task_id)
        response.success = task is not None
        if task is None:
            response.message = f"There is no task {request.task_id}"
            return response
        self.manager.reckon()
        response.task = self._messages.whole_task_info(
            task, self.manager.estimate(task.task_id), self.manager.changes(task)
        )
        return response

    async def watch(self, request: Any, response: Any) -> Any:
        """Wait for changes; see WatchTasks.srv."""
        board, only = self.manager.board, request.task_id
        response.success = not only or self.manager.book.find(only) is not None
        if not response.success:
            response.message = f"There is no task {only}"
            return response
        await board.wait_for_change(request.revision, _patience(request.timeout), task_id=only)
        changed = board.changed_since(request.revision)
        response.complete = changed is not None and len(changed) <= _WATCHED_TASKS
        if only and (changed is None or only in changed):
            response.complete, changed = True, [only]
        elif only:
            changed = []
        response.revision = board.revision
        response.paused = self.manager.is_paused
        if response.complete and changed:
            self._fill(response, changed)
        return response

    async def cancel(self, request: Any, response: Any) -> Any:
        """Call a task off; see CancelTask.srv."""
        refuse_others_task(self.manager.book.find(request.task_id))
        return _answered(response, await self.manager.cancel(request.task_id, client=client_name()))

    async def pause(self, request: Any, response: Any) -> Any:
        """Halt the robot and the queue; see PauseTasks.srv."""
        return _answered(response, await self.manager.pause())

    async def resume(self, request: Any, response: Any) -> Any:
        """Go on; see ResumeTasks.srv."""
        return _answered(response, await self.manager.resume())

    async def reprioritise(self, request: Any, response: Any) -> Any:
        """Move a task to another priority; see ReprioritiseTask.srv."""
        answer = await self.manager.reprioritise(request.task_id, request.priority)
        return _answered(response, answer)

    async def requeue(self, request: Any, response: Any) -> Any:
        """Queue a task once more; see RequeueTask.srv."""
        return _answered(
            response, await self.manager.requeue(request.task_id, resume=request.resume)
        )

    async def drop(self, request: Any, response: Any) -> Any:
        """Give a task up; see DropTask.srv."""
        refuse_others_task(self.manager.book.find(request.task_id))
        return _answered(response, await self.manager.drop(request.task_id, client=client_name()))

    async def stop(self, request: Any, response: Any) -> Any:
        """Halt the robot at once; see StopRobot.srv."""
        return _answered(response, await self.manager.stop(client=client_name()))

    async def tell_health(self, request: Any, response: Any) -> Any:
        """Say whether tasks are taken now; a std_srvs/srv/Trigger."""
        return _answered(response, await self.health())

    def _fill(self, response: Any, changed: list[int]) -> None:
        self.manager.reckon()
        found = (self.manager.book.find(task_id) for task_id in changed)
        response.tasks = [self._info(task) for task in found if task is not None]

    def _info(self, task: Task) -> Any:
        return self._messages.task_info(task, self.manager.estimate(task.task_id))


def _failed(unstored: Code, error: TaskRpcError) -> HandlerError:
    """What the caller is told of a store that failed; the log has the whole of it."""
    _log.error("%s", error)
    code = Code.OUTCOME_UNKNOWN if isinstance(error, OutcomeUnknown) else unstored
    return HandlerError(code, told(error))


def _tell_queued(queued: asyncio.Future[Any], response: Any, error: BaseException | None) -> None:
    """A task is stored, for which the response was filled in, or is not."""
    if queued.done():
        return  # nobody waits any more
    if error is None:
        queued.set_result(response)
    elif isinstance(error, StoreError | OutcomeUnknown):
        queued.set_exception(_failed(Code.UNAVAILABLE, error))  # nothing was done, or who knows
    elif isinstance(error, asyncio.CancelledError):
        queued.cancel()
    else:
        queued.set_exception(error)


def _answered(response: Any, answer: Answer) -> Any:
    response.success = answer.success
    response.message = answer.message
    if hasattr(response, "task_id"):
        response.task_id = answer.task_id
    if hasattr(response, "estimated_time"):
        response.estimated_time = answer.estimated_time
    return response


def _completed(response: Any) -> Completion | None:
    try:
        return current_call().completed_by(response)
    except LookupError:  # called without a network
        return None


def _nothing_done() -> None:
    with contextlib.suppress(LookupError):  # called without a network
        current_call().nothing_done()


def _patience(asked: float) -> float:
    """Seconds that a watcher may wait, so that its answer comes before it gives up."""
    patience = min(asked if asked > 0 else _WATCH_SECONDS, _WATCH_AT_MOST)
    try:
        left = current_call().time_left()
    except LookupError:
        left = None
    return patience if left is None else min(patience, left * _WATCH_SHARE)
