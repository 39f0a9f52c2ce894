"""Carries out calls of tools: calls of services, and goals of actions.

Every call ends with a result that the agent can read, also when it fails.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, TypeAlias

import msgspec

from srvgen import FieldError
from taskrpc import GoalHandle
from taskrpc.bridges.mcp.arguments import REQUEST_ID, Arguments, message_of, split
from taskrpc.bridges.mcp.permissions import Permissions
from taskrpc.bridges.mcp.results import EXPLAINED, Result, dry_run, failure, json_of, response
from taskrpc.bridges.mcp.tools import Target, Tools, estimator_of
from taskrpc.bridges.rosbridge.actions import ActionClients
from taskrpc.bridges.rosbridge.services import ServiceClients
from taskrpc.bridges.rosbridge.types import action_class
from taskrpc.client import Client
from taskrpc.errors import GoalFailed, ServerBusy, ServiceUnavailable, TaskRpcError, TypeMismatch
from taskrpc.node import Node

log = logging.getLogger("taskrpc.mcp")

Progress: TypeAlias = Callable[[float, float | None, str | None], Awaitable[None]]
"""Reports the progress of a call: how far it is, of how much, and a text."""

TIMEOUT = 60.0
"""Seconds for the call of a service, as MCP clients usually wait."""
MAX_CALLS = 64
"""Calls of tools that may run at a time; a further one is refused."""
_CANCEL_TIMEOUT = 5.0
"""Seconds for the server of an action to accept that a goal is cancelled."""


class ToolCalls:
    """Carries out the calls of one agent; `close` cancels its goals."""

    def __init__(self, node: Node, permissions: Permissions) -> None:
        self._permissions = permissions
        self._clients = ServiceClients(node)
        self._actions = ActionClients(node)
        self._running: set[asyncio.Task[Result]] = set()
        """The goals that have not ended."""
        self._calls = 0
        """Calls that run now."""
        self.tools = Tools(node, self._clients, permissions)
        """The tools that the agent may call."""

    async def call(
        self,
        tool: str,
        given: Mapping[str, object],
        request_id: str,
        progress: Progress,
    ) -> Result:
        """Carry out one call of a tool.

        A service that runs requests once gets `request_id`, unless the agent has given its own;
        with "", each call is a request of its own. Cancelling the task cancels the call or goal.
        """
        if self._calls >= MAX_CALLS:
            return failure(ServerBusy(f"expected at most {MAX_CALLS} calls at a time"))
        self._calls += 1
        try:
            arguments = split(given)
            target = await self.tools.target(tool)
            if target.kind == "action":
                return await self._goal(target, arguments, progress)
            return await self._service(target, arguments, request_id)
        except EXPLAINED as error:
            return failure(error)
        except Exception as error:
            log.exception("a call of the tool %s failed", tool)
            return failure(error)
        finally:
            self._calls -= 1

    async def close(self) -> None:
        """Cancel all goals, and wait until their servers have accepted this."""
        running = list(self._running)
        for goal in running:
            goal.cancel()
        await asyncio.gather(*running, return_exceptions=True)

    # Services

    async def _service(self, target: Target, arguments: Arguments, request_id: str) -> Result:
        deadline = asyncio.get_running_loop().time() + TIMEOUT
        client = await self._clients.client(target.name, deadline)
        self.tools.refuse_changed(target, client.srv_type)
        request = message_of(client.srv_type.Request, arguments.fields)
        if not self._permissions.check("call", target.name, request) or arguments.is_dry_run:
            return await self._dry_run(target, request)
        await client.channel.connect(deadline)
        name = arguments.request_id or request_id if client.channel.store_id else ""
        if arguments.request_id and not name:
            problem = f"{target.name} does not run a repeated request once; leave this out"
            raise FieldError(REQUEST_ID, problem)
        try:
            return response(await self._called(client, request, deadline, name))
        except TypeMismatch as error:
            self._clients.forget(target.name)
            return failure(error)
        except TaskRpcError as error:
            return failure(error, name)

    async def _called(
        self, client: Client[Any, Any], request: Any, deadline: float, name: str
    ) -> Any:
        left = deadline - asyncio.get_running_loop().time()
        # Other agents and programs may choose the same id for other requests.
        own = f"mcp {self._permissions.name} {name}" if name else ""
        return await client.call(request, timeout=left, request_id=own)

    # Dry runs

    async def _dry_run(self, target: Target, message: Any) -> Result:
        """Say what a call would do; for a task of a task server, also when the task would end."""
        estimate = None
        if (estimator := estimator_of(target)) is not None:
            with contextlib.suppress(ServiceUnavailable):  # a task server of another project
                estimate = await self._estimate(estimator, message)
        return dry_run(target.name, message, estimate)

    async def _estimate(self, estimator: str, task: Any) -> Any:
        deadline = asyncio.get_running_loop().time() + TIMEOUT
        client = await self._clients.client(estimator, deadline)
        given = {name: getattr(task, name) for name, _ in task._FIELDS}
        return await client.call(message_of(client.srv_type.Request, given), timeout=TIMEOUT)

    # Actions

    async def _goal(self, target: Target, arguments: Arguments, progress: Progress) -> Result:
        cls = action_class(target.type_name)
        self.tools.refuse_changed(target, cls)
        goal = message_of(cls.Goal, arguments.fields)
        if arguments.request_id:
            raise FieldError(REQUEST_ID, f"the action {target.name} has none; leave this out")
        if not self._permissions.check("call", target.name, goal) or arguments.is_dry_run:
            return await self._dry_run(target, goal)
        # A task of its own: a cancelled call must still be able to cancel its goal.
        task = asyncio.create_task(self._follow(target.name, cls, goal, progress))
        self._running.add(task)
        task.add_done_callback(self._running.discard)
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            task.cancel()
            raise

    async def _follow(self, action: str, cls: Any, goal: Any, progress: Progress) -> Result:
        """Send a goal, and follow it to its end; no goal continues that the agent cannot see."""
        async with self._actions.using(action, cls) as client:
            handle = await client.send_goal(goal)
            try:
                await _report(handle, progress)
                return response(await handle.result())
            except GoalFailed:
                raise
            except BaseException:  # the call was cancelled, or its progress cannot be sent
                await _cancel(action, handle)
                raise


async def _report(handle: GoalHandle[Any, Any], progress: Progress) -> None:
    """Report the feedback of a goal until it ends.

    If the feedback has a field `progress` from 0 to 1, it is the progress, and feedback without
    any is left out: MCP allows only numbers that grow. Otherwise the messages are counted.
    """
    count, last = 0, -1.0
    async for feedback in handle.feedback:
        count += 1
        value = json_of(feedback)
        text = msgspec.json.encode(value).decode()
        done = value.get("progress")
        if not isinstance(done, float) or not 0.0 <= done <= 1.0:
            await progress(float(count), None, text)
        elif done > last:
            last = done
            await progress(done, 1.0, text)


async def _cancel(action: str, handle: GoalHandle[Any, Any]) -> None:
    try:
        if not await handle.cancel(timeout=_CANCEL_TIMEOUT):
            log.warning("the server of %s does not cancel a goal of the agent", action)
    except TaskRpcError as error:
        log.warning("a goal of %s could not be cancelled: %s", action, error)
