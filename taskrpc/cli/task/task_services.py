"""The task server's services, as commands call them; and its news, for those who follow it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from typing import Any, NamedTuple

import srvgen
from taskrpc import names
from taskrpc.cli.shared.command import NotFound
from taskrpc.cli.shared.graph import why_unavailable
from taskrpc.client import Client
from taskrpc.errors import (
    Code,
    ConnectionLost,
    DeadlineExceeded,
    HandlerFailed,
    OutcomeUnknown,
    ServiceUnavailable,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.node import Node

DEFAULT_SERVICE = "/robot_task"
DEFAULT_TIMEOUT = 10.0

_TYPES = {
    "": "my_robot_interfaces/srv/RobotTask",
    "/list": "taskrpc_interfaces/srv/ListTasks",
    "/show": "taskrpc_interfaces/srv/ShowTask",
    "/watch": "taskrpc_interfaces/srv/WatchTasks",
    "/cancel": "taskrpc_interfaces/srv/CancelTask",
    "/pause": "taskrpc_interfaces/srv/PauseTasks",
    "/resume": "taskrpc_interfaces/srv/ResumeTasks",
    "/reprioritise": "taskrpc_interfaces/srv/ReprioritiseTask",
    "/requeue": "taskrpc_interfaces/srv/RequeueTask",
    "/drop": "taskrpc_interfaces/srv/DropTask",
    "/stop": "taskrpc_interfaces/srv/StopRobot",
}
_WATCH_SECONDS = 20.0  # how long the server may keep a watcher waiting; it hears of an end at once
_ENDING = 0.5
"""Seconds in which a server that said it ends may still answer: not asked again before."""


class TaskRefused(TaskRpcError):
    """The task server refused what was asked; the text is its own."""


class Update(NamedTuple):
    """News of the task server."""

    tasks: list[Any]
    """The tasks that changed, as TaskInfo messages."""
    paused: bool
    """Whether the queue stands still."""


class TaskServices:
    """Calls the services of one task server.

    Args:
        node: a started node; it stays the caller's.
        service: the name of the service that takes tasks.
        timeout: seconds of one call, waiting for the server included.
        place: the `host:port` that the node calls, empty for the programs of this machine.
        note: is told, in a sentence, that we wait for the server.
    """

    def __init__(
        self,
        node: Node,
        service: str = DEFAULT_SERVICE,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        place: str = "",
        note: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.service = names.expand(service)
        self._node = node
        self._timeout = timeout
        self._place = place
        self._note = note
        self._clients: dict[str, Client[Any, Any]] = {}

    async def reach(self) -> None:
        """Wait for the server.

        Raises ServiceUnavailable when none came within the timeout, TypeMismatch.
        """
        try:
            type_name, _ = await self._node.definition(self.service)
        except (ServiceUnavailable, ConnectionLost) as error:
            lost = error if isinstance(error, ConnectionLost) else None
            self._note(f"waiting for {self.service} to become available; taskrpc-server offers it")
            if not await self._client("").wait_for_service(self._timeout):
                raise await self._nobody(lost) from None
            return
        if type_name != _TYPES[""]:
            raise TypeMismatch(f"{self.service} is offered as {type_name}, not as {_TYPES['']}")

    async def submit(self, task_type: str, target: str, priority: int) -> Any:
        """Queue a task and return the answer; raises TaskRefused."""
        return await self.ask("", task_type=task_type, target=target, priority=priority)

    async def ask(self, verb: str, **fields: Any) -> Any:
        """Call the service of a verb such as `/cancel`; raises TaskRefused and what calls raise."""
        response = await self._call(verb, self._timeout, fields)
        if not response.success:
            raise TaskRefused(response.message)
        return response

    async def show(self, task_id: int) -> Any:
        """Everything about one task, as a TaskInfo message; raises NotFound."""
        response = await self._call("/show", self._timeout, {"task_id": task_id})
        if not response.success:
            raise NotFound(response.message)
        return response.task

    async def tasks(self, *, ended: bool = False) -> list[Any]:
        """All tasks, page by page: what runs, the queue in the order of run, what has ended."""
        found: list[Any] = []
        page = ""
        while True:
            answer = await self._call("/list", self._timeout, {"all": ended, "page": page})
            found += answer.tasks
            page = answer.next_page
            if not page:
                return found

    async def follow(
        self, task_id: int = 0, *, seconds: float = _WATCH_SECONDS, persist: bool = True
    ) -> AsyncGenerator[Update, None]:
        """Yield what changes, the present state first; at least one update every `seconds`.

        Where a task is named, every update has that task and no other. A server that goes is
        waited for, for ever or (without `persist`) for the timeout; what ended meanwhile is
        yielded when it is back.

        Raises NotFound when there is no such task, ServiceUnavailable.
        """
        revision, open_ids = 0, set[int]()
        request = {"task_id": task_id, "timeout": seconds}
        while True:
            try:
                news = await self._call(
                    "/watch", seconds + self._timeout, {"revision": revision, **request}
                )
                if not news.success:
                    raise NotFound(news.message)
                tasks = news.tasks if news.complete else await self._afresh(open_ids)
                if task_id and not tasks:
                    tasks = [await self.show(task_id)]
            except (ServiceUnavailable, ConnectionLost):
                await self._wait_for_return(persist)
                continue
            revision = news.revision
            for task in tasks:
                (open_ids.discard if task.ended.sec else open_ids.add)(task.task_id)
            yield Update(tasks, news.paused)

    async def _afresh(self, open_ids: set[int]) -> list[Any]:
        """The tasks that run or wait, and those that did when we last looked."""
        tasks = await self.tasks()
        gone = open_ids.difference(task.task_id for task in tasks)
        for task_id in sorted(gone):
            response = await self._call("/show", self._timeout, {"task_id": task_id})
            if response.success:  # else it was forgotten
                tasks.append(response.task)
        return tasks

    async def _wait_for_return(self, persist: bool) -> None:
        self._note("the task server has ended; waiting for its next start...")
        await asyncio.sleep(_ENDING)
        patience = None if persist else self._timeout
        if not await self._client("/watch").wait_for_service(patience):
            gone = f"{self.service} did not come back within {patience:g} s"
            stored = "it has stored the tasks that it accepted, and continues with them"
            raise OutcomeUnknown(f"{gone}; {stored}")
        self._note("the task server is back")

    async def _nobody(self, lost: TaskRpcError | None) -> ServiceUnavailable:
        waited = f"(waited {self._timeout:g} s)"
        error = await why_unavailable(self.service, self._place, self._node, waited, lost)
        (hint,) = error.__notes__
        if str(error).startswith("no server offers") and "taskrpc-server" not in hint:
            error.__notes__ = [f"start the task server: taskrpc-server ({hint})"]
        return error

    async def _call(self, verb: str, timeout: float, fields: dict[str, Any]) -> Any:
        client = self._client(verb)
        try:
            return await client.call(client.srv_type.Request(**fields), timeout=timeout)
        except DeadlineExceeded as error:
            problem = f"no answer from {client.service_name} within {timeout:g} s"
            raise DeadlineExceeded(problem, not_executed=error.not_executed) from None
        except HandlerFailed as error:
            if error.code is Code.UNAVAILABLE:  # it is ending, and has not done it
                raise ServiceUnavailable(f"{client.service_name}: {error}") from None
            raise

    def _client(self, verb: str) -> Client[Any, Any]:
        client = self._clients.get(verb)
        if client is None:
            srv_type = srvgen.load(_TYPES[verb])
            client = self._clients[verb] = self._node.create_client(srv_type, self.service + verb)
        return client
