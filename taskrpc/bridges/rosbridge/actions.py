"""Actions for clients of rosbridge: the goals that they send, and the actions that they offer."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from typing import Any, TypeAlias

import srvgen
from taskrpc import ActionClient, GoalHandle, GoalState, ServerGoal
from taskrpc.bridges.rosbridge.protocol import (
    ActionFeedback,
    ActionResult,
    AdvertiseAction,
    BadOperation,
    CancelActionGoal,
    Id,
    SendActionGoal,
    count_of,
    encode,
    split,
)
from taskrpc.bridges.rosbridge.types import action_class
from taskrpc.bridges.rosbridge.values import from_json, request_from_json, to_json
from taskrpc.errors import (
    Code,
    GoalAborted,
    GoalCanceled,
    HandlerError,
    OutcomeUnknown,
    ServerBusy,
    TaskRpcError,
)
from taskrpc.node import Node

log = logging.getLogger("taskrpc.rosbridge")

Send: TypeAlias = Callable[[str], object]
"""Sends a text to the client."""

MAX_GOALS = 64
"""Goals of one client that have not ended; a further one is refused."""
_KEPT_CLIENTS = 16
"""Actions without goals for which the gateway keeps a client."""
_MAX_OPEN = 64
"""Goals of one offered action that run at a time; later ones wait."""
_REFUSALS = (TaskRpcError, srvgen.DefinitionError, srvgen.FieldError)
"""Errors whose text tells the client what is wrong."""


class ActionClients:
    """Clients of actions, by name and type; for all sessions."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[tuple[str, Any], ActionClient[Any, Any, Any]] = {}
        """In the order of their last use."""
        self._users: dict[tuple[str, Any], int] = {}
        """How many goals use each client."""

    @contextlib.asynccontextmanager
    async def using(self, action: str, cls: Any) -> AsyncIterator[ActionClient[Any, Any, Any]]:
        """Yield a client of an action, which lives at least as long as the block."""
        key = self._node.resolve_service_name(action), cls
        client = self._clients.pop(key, None)
        if client is None:
            client = self._node.create_action_client(cls, action)
        self._clients[key] = client
        self._users[key] = self._users.get(key, 0) + 1
        try:
            yield client
        finally:
            self._users[key] -= 1
            if not self._users[key]:
                del self._users[key]
                self._destroy_oldest()

    def _destroy_oldest(self) -> None:
        idle = [key for key in self._clients if key not in self._users]
        for key in idle[: max(0, len(idle) - _KEPT_CLIENTS)]:
            self._clients.pop(key).destroy()


class ClientGoals:
    """The goals that one client has sent and that have not ended.

    `is_behind` returns whether the client has much to read. Then feedback waits until `drained` is
    called, and old feedback is dropped. `warn` sends the client a status.
    """

    def __init__(
        self,
        clients: ActionClients,
        send: Send,
        is_behind: Callable[[], bool],
        warn: Callable[[str, Id], object],
    ) -> None:
        self._clients = clients
        self._send = send
        self._is_behind = is_behind
        self._warn = warn
        self._goals: dict[Id, _ClientGoal] = {}
        self._drained = asyncio.Event()

    def begin(self, operation: SendActionGoal) -> None:
        """Send a goal; the client gets its feedback and its result.

        Raises BadOperation if a goal with this id has not ended.
        """
        if operation.id in self._goals:
            problem = f"send_action_goal: the goal with the id {operation.id!r} has not ended"
            raise BadOperation(problem, operation.id)
        if len(self._goals) >= MAX_GOALS:
            self.refuse(operation, ServerBusy(f"expected at most {MAX_GOALS} goals at a time"))
            return
        goal = _ClientGoal(operation)
        goal.task = asyncio.get_running_loop().create_task(self._run(goal))
        self._goals[operation.id] = goal

    def refuse(self, operation: SendActionGoal, error: TaskRpcError) -> None:
        """Respond to a goal that is not sent, or that the gateway follows no longer."""
        self._respond(operation, *_failure(error), result=False)

    def cancel(self, operation: CancelActionGoal) -> None:
        """Cancel a goal. Raises BadOperation if the client has no goal with this id."""
        goal = self._goals.get(operation.id)
        if goal is None:
            problem = f"cancel_action_goal: no goal with the id {operation.id!r} waits for its end"
            raise BadOperation(problem, operation.id)
        goal.cancelled.set()

    def drained(self) -> None:
        """Continue with the feedback, after the client has read what it had got."""
        self._drained.set()
        self._drained.clear()

    def end(self, reason: str) -> None:
        """Respond to all goals, because the gateway ends; the goals continue."""
        goals = list(self._goals.values())
        self.close()
        for goal in goals:
            self.refuse(goal.operation, OutcomeUnknown(f"{reason}; the goal may continue"))

    def close(self) -> None:
        """Forget all goals; those that the server has accepted continue."""
        for goal in self._goals.values():
            if goal.task is not None:
                goal.task.cancel()
        self._goals.clear()

    async def _run(self, goal: _ClientGoal) -> None:
        """Carry one goal from its sending to its result."""
        operation = goal.operation
        try:
            state, values, is_result = await self._outcome(goal)
        except asyncio.CancelledError:
            raise
        except Exception as error:
            if not isinstance(error, _REFUSALS):
                log.exception("a goal of %s for a client failed", operation.action)
            state, values, is_result = *_failure(error), False
        if self._goals.pop(operation.id, None) is not goal:
            return  # `end` has responded
        self._respond(operation, state, values, result=is_result)

    async def _outcome(self, goal: _ClientGoal) -> tuple[GoalState, object, bool]:
        """Return the final state, and the result or a text; the flag says which of both.

        Raises the errors of `ActionClient.send_goal` and `GoalHandle.result`.
        """
        operation = goal.operation
        cls = action_class(operation.action_type)
        message = request_from_json(cls.Goal, operation.args)
        async with self._clients.using(operation.action, cls) as client:
            handle = await client.send_goal(message)
            cancelling = asyncio.ensure_future(self._cancel_if_asked(goal, handle))
            try:
                await self._pass_on_feedback(operation, handle)
                result = await handle.result()
            except (GoalAborted, GoalCanceled) as error:
                if error.result is None:
                    return handle.state, f"{type(error).__name__}: {error}", False
                return handle.state, to_json(error.result), True
            finally:
                cancelling.cancel()
            return handle.state, to_json(result), True

    async def _cancel_if_asked(self, goal: _ClientGoal, handle: GoalHandle[Any, Any]) -> None:
        """Cancel a goal when the client asks for it; warn the client if the server refuses."""
        while True:
            await goal.cancelled.wait()
            goal.cancelled.clear()
            problem = "the server does not cancel the goal"
            try:
                if await handle.cancel():
                    continue
            except TaskRpcError as error:
                problem = f"{type(error).__name__}: {error}"
            self._warn(f"cancel_action_goal: {problem}", goal.operation.id)

    async def _pass_on_feedback(
        self, operation: SendActionGoal, handle: GoalHandle[Any, Any]
    ) -> None:
        """Send the client the feedback until the goal ends, if the client wants it."""
        if not operation.feedback:
            return
        async for feedback in handle.feedback:
            self._send_operation(operation, "action_feedback", {"values": to_json(feedback)})
            while self._is_behind():
                await self._drained.wait()

    def _respond(
        self, operation: SendActionGoal, state: GoalState, values: object, *, result: bool
    ) -> None:
        fields = {"values": values, "status": int(state), "result": result}
        self._send_operation(operation, "action_result", fields)

    def _send_operation(
        self, operation: SendActionGoal, name: str, fields: Mapping[str, Any]
    ) -> None:
        known = {} if operation.id is None else {"id": operation.id}
        text = encode({"op": name, "action": operation.action, **known, **fields})
        size = count_of(operation.fragment_size, 0, 2**31)
        for part in split(text, size, f"{name}:{operation.id}"):
            self._send(part)


class _ClientGoal:
    """A goal that a client has sent."""

    def __init__(self, operation: SendActionGoal) -> None:
        self.operation = operation
        self.cancelled = asyncio.Event()
        """Set when the client has asked to cancel the goal."""
        self.task: asyncio.Task[None] | None = None


def _failure(error: BaseException) -> tuple[GoalState, str]:
    state = GoalState.ABORTED if isinstance(error, GoalAborted) else GoalState.UNKNOWN
    return state, f"{type(error).__name__}: {error}"


class OfferedAction:
    """An action that a client offers: each goal becomes a `send_action_goal` for the client.

    `numbers` numbers all goals of the client, as in `OfferedService`.
    """

    def __init__(
        self, node: Node, operation: AdvertiseAction, send: Send, numbers: Iterator[int]
    ) -> None:
        self._cls = action_class(operation.type)
        self._operation = operation  # the client compares the name with its own spelling
        self._send = send
        self._open: dict[str, tuple[ServerGoal[Any, Any, Any], asyncio.Future[Any]]] = {}
        """The goals that wait for the client's result, by id."""
        self._numbers = numbers
        self._server = node.create_action_server(
            self._cls, operation.action, self._execute, concurrency=_MAX_OPEN
        )

    async def _execute(self, goal: ServerGoal[Any, Any, Any]) -> Any:
        action, kind = self._operation.action, self._operation.type
        name = f"action_goal:{action}:{next(self._numbers)}"
        ended: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._open[name] = goal, ended
        known = {"id": name, "action": action}
        args = {"action_type": kind, "args": to_json(goal.request), "feedback": True}
        self._send(encode({"op": "send_action_goal", **known, **args}))
        cancelling = asyncio.ensure_future(goal.wait_for_cancel())
        try:
            await asyncio.wait([cancelling, ended], return_when=asyncio.FIRST_COMPLETED)
            if not ended.done():
                self._send(encode({"op": "cancel_action_goal", **known}))
            state, result = await ended
        finally:
            cancelling.cancel()
            del self._open[name]
        if state == GoalState.CANCELED and goal.is_cancel_requested:
            return goal.canceled(result)
        return result if state == GoalState.SUCCEEDED else goal.abort(result)

    def waits_for(self, operation: ActionFeedback | ActionResult) -> bool:
        """Whether a goal of this action with the operation's id has not ended."""
        return operation.id in self._open

    def publish(self, operation: ActionFeedback) -> None:
        """Publish the feedback of a goal. Raises FieldError if it does not fit."""
        goal, _ = self._open[str(operation.id)]
        values = {} if operation.values is None else operation.values
        goal.publish_feedback(from_json(self._cls.Feedback, values))

    def finish(self, operation: ActionResult) -> None:
        """End a goal with the client's result.

        Raises FieldError for a result that does not fit; the goal is aborted then.
        """
        _, ended = self._open[str(operation.id)]
        if ended.done():
            return
        if not operation.result:
            reason = operation.values if isinstance(operation.values, str) else ""
            ended.set_exception(HandlerError(Code.UNKNOWN, reason or "the goal failed"))
            return
        values = {} if operation.values is None else operation.values
        try:
            ended.set_result((operation.status, from_json(self._cls.Result, values)))
        except srvgen.FieldError as error:
            problem = f"the rosbridge client of the action sent an invalid result: {error}"
            ended.set_exception(HandlerError(Code.INTERNAL, problem))
            raise

    def close(self) -> None:
        """Withdraw the action; the clients of its goals get OutcomeUnknown."""
        self._server.abandon()
