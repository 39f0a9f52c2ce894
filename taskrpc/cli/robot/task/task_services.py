"""Calls the services of a task server, and follows its change feed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import srvgen
from taskrpc.cli.shared.command import NotFound
from taskrpc.cli.shared.graph import why_unavailable
from taskrpc.cli.shared.remote import HERE, Remote
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
from taskrpc.message_types import RequestT, ResponseT
from taskrpc.node import Node
from taskrpc.spi import names

if TYPE_CHECKING:
    from srvgen.stubs.my_robot_interfaces.srv import RobotTask
    from srvgen.stubs.taskrpc_interfaces.msg import TaskInfo
    from srvgen.stubs.taskrpc_interfaces.srv import ListTasks, ShowTask, WatchTasks

DEFAULT_SERVICE = "/robot_task"
DEFAULT_TIMEOUT = 10.0

_SUBMIT: Final = "my_robot_interfaces/srv/RobotTask"
_LIST: Final = "taskrpc_interfaces/srv/ListTasks"
_SHOW: Final = "taskrpc_interfaces/srv/ShowTask"
_WATCH: Final = "taskrpc_interfaces/srv/WatchTasks"
_TYPES = {
    "": _SUBMIT,
    "/list": _LIST,
    "/show": _SHOW,
    "/watch": _WATCH,
    "/cancel": "taskrpc_interfaces/srv/CancelTask",
    "/pause": "taskrpc_interfaces/srv/PauseTasks",
    "/resume": "taskrpc_interfaces/srv/ResumeTasks",
    "/reprioritise": "taskrpc_interfaces/srv/ReprioritiseTask",
    "/requeue": "taskrpc_interfaces/srv/RequeueTask",
    "/drop": "taskrpc_interfaces/srv/DropTask",
    "/stop": "taskrpc_interfaces/srv/StopRobot",
}
_WATCH_SECONDS = 20.0  # longest wait of one watch call; the server responds at once when it ends
_ENDING = 0.5
"""Seconds until the next call after a server has ended: until then it may still respond."""


class TaskRefused(TaskRpcError):
    """The task server refused a request; the text is the server's."""


class Update(NamedTuple):
    """Changes that the task server has reported."""

    tasks: list[TaskInfo]
    """The tasks that changed, as TaskInfo messages."""
    paused: bool
    """Whether the queue is paused."""


class TaskServices:
    """Calls the services of one task server.

    Args:
        node: a started node; the caller closes it.
        service: the name of the service that accepts tasks.
        timeout: seconds for one call, including the wait for the server.
        remote: the programs that the node calls.
        note: gets a sentence when a method waits for the server.
    """

    def __init__(
        self,
        node: Node,
        service: str = DEFAULT_SERVICE,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        remote: Remote = HERE,
        note: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.service = names.expand(service)
        self._node = node
        self._timeout = timeout
        self._remote = remote
        self._note = note
        self._clients: dict[str, Client[Any, Any]] = {}

    async def reach(self) -> None:
        """Wait for the server.

        Raises ServiceUnavailable if there is none within the timeout, and TypeMismatch.
        """
        try:
            type_name, _ = await self._node.definition(self.service)
        except (ServiceUnavailable, ConnectionLost) as error:
            lost = error if isinstance(error, ConnectionLost) else None
            self._note(f"waiting for {self.service} to become available; taskrpc-server offers it")
            if not await self._client("").wait_for_service(self._timeout):
                raise await self._unavailable(lost) from None
            return
        if type_name != _TYPES[""]:
            raise TypeMismatch(f"{self.service} is offered as {type_name}, not as {_TYPES['']}")

    async def submit(self, task_type: str, target: str, priority: int) -> RobotTask.Response:
        """Queue a task and return the response. Raises TaskRefused."""
        request = srvgen.load(_SUBMIT).Request(
            task_type=task_type, target=target, priority=priority
        )
        client: Client[RobotTask.Request, RobotTask.Response] = self._client("")
        response = await self._call(client, request, self._timeout)
        if not response.success:
            raise TaskRefused(response.message)
        return response

    async def request(self, verb: str, **fields: Any) -> Any:
        """Call the service of a verb such as `/cancel`; returns the response.

        Raises TaskRefused and the errors of calls.
        """
        client = self._client(verb)
        response = await self._call(client, client.srv_type.Request(**fields), self._timeout)
        if not response.success:
            raise TaskRefused(response.message)
        return response

    async def show(self, task_id: int) -> TaskInfo:
        """Return everything about one task, as a TaskInfo message. Raises NotFound."""
        response = await self._show(task_id)
        if not response.success:
            raise NotFound(response.message)
        return response.task

    async def _show(self, task_id: int) -> ShowTask.Response:
        client: Client[ShowTask.Request, ShowTask.Response] = self._client("/show")
        request = srvgen.load(_SHOW).Request(task_id=task_id)
        return await self._call(client, request, self._timeout)

    async def tasks(self, *, ended: bool = False) -> list[TaskInfo]:
        """Return all tasks: the running task, the queue in order, with `ended` the ended tasks."""
        client: Client[ListTasks.Request, ListTasks.Response] = self._client("/list")
        found: list[TaskInfo] = []
        page = ""
        while True:
            request = srvgen.load(_LIST).Request(all=ended, page=page)
            response = await self._call(client, request, self._timeout)
            found += response.tasks
            page = response.next_page
            if not page:
                return found

    async def follow(
        self, task_id: int = 0, *, seconds: float = _WATCH_SECONDS, persist: bool = True
    ) -> AsyncGenerator[Update, None]:
        """Yield the current state, then each change; at least one update every `seconds`.

        With a `task_id`, every update contains only this task. If the server ends, this waits for
        its next start: for ever, or without `persist` for the timeout. It then yields the tasks
        that have ended since.

        Raises NotFound if there is no such task, and OutcomeUnknown if the server does not start
        again within the timeout.
        """
        revision, open_ids = 0, set[int]()
        client: Client[WatchTasks.Request, WatchTasks.Response] = self._client("/watch")
        request = srvgen.load(_WATCH).Request(task_id=task_id, timeout=seconds)
        while True:
            try:
                request.revision = revision
                changes = await self._call(client, request, seconds + self._timeout)
                if not changes.success:
                    raise NotFound(changes.message)
                tasks = changes.tasks if changes.complete else await self._read_all(open_ids)
                if task_id and not tasks:
                    tasks = [await self.show(task_id)]
            except (ServiceUnavailable, ConnectionLost):
                await self._wait_for_return(persist)
                continue
            revision = changes.revision
            for task in tasks:
                (open_ids.discard if task.ended.sec else open_ids.add)(task.task_id)
            yield Update(tasks, changes.paused)

    async def _read_all(self, open_ids: set[int]) -> list[TaskInfo]:
        """Return the running and queued tasks, and the `open_ids` that have ended since."""
        tasks = await self.tasks()
        gone = open_ids.difference(task.task_id for task in tasks)
        for task_id in sorted(gone):
            response = await self._show(task_id)
            if response.success:  # otherwise the server has forgotten the task
                tasks.append(response.task)
        return tasks

    async def _wait_for_return(self, persist: bool) -> None:
        self._note("the task server has ended; waiting for its next start...")
        await asyncio.sleep(_ENDING)
        timeout = None if persist else self._timeout
        if not await self._client("/watch").wait_for_service(timeout):
            gone = f"{self.service} did not come back within {timeout:g} s"
            stored = "it has stored the tasks that it accepted, and continues with them"
            raise OutcomeUnknown(f"{gone}; {stored}")
        self._note("the task server is back")

    async def _unavailable(self, lost: TaskRpcError | None) -> ServiceUnavailable:
        waited = f"(waited {self._timeout:g} s)"
        error = await why_unavailable(self.service, self._remote, self._node, waited, lost)
        (hint,) = error.__notes__
        if str(error).startswith("no server offers") and "taskrpc-server" not in hint:
            error.__notes__ = [f"start the task server: taskrpc-server ({hint})"]
        return error

    async def _call(
        self, client: Client[RequestT, ResponseT], request: RequestT, timeout: float
    ) -> ResponseT:
        try:
            return await client.call(request, timeout=timeout)
        except DeadlineExceeded as error:
            problem = f"no response from {client.service_name} within {timeout:g} s"
            raise DeadlineExceeded(problem, not_executed=error.not_executed) from None
        except HandlerFailed as error:
            if error.code is Code.UNAVAILABLE:  # the server is ending and did not run the call
                raise ServiceUnavailable(f"{client.service_name}: {error}") from None
            raise

    def _client(self, verb: str) -> Client[Any, Any]:
        client = self._clients.get(verb)
        if client is None:
            srv_type = srvgen.load(_TYPES[verb])
            client = self._clients[verb] = self._node.create_client(srv_type, self.service + verb)
        return client
