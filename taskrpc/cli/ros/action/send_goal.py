"""`taskrpc action send_goal`: sends a goal, prints its feedback and its result."""

from __future__ import annotations

import asyncio
import json
import sys
from typing import TYPE_CHECKING, Any

import msgspec

import srvgen
from taskrpc import GoalState
from taskrpc.cli.ros.action.action_graph import action_type, actions
from taskrpc.cli.shared import graph, quoting
from taskrpc.cli.shared.calling import without_nan
from taskrpc.cli.shared.command import Exit, hinted
from taskrpc.cli.shared.remote import HERE, Remote
from taskrpc.cli.shared.values import as_typed, build_request
from taskrpc.errors import (
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    ServiceUnavailable,
    TaskRpcError,
)
from taskrpc.ros.message_text import Cut, yaml_of

if TYPE_CHECKING:
    from taskrpc import ActionClient, GoalHandle
    from taskrpc.node import Node

_POLL = 0.05
"""Seconds between two looks for an action whose type is not known yet."""
_FULL = Cut(None)


class Plan(msgspec.Struct, frozen=True):
    """The goal that a command line describes."""

    action: str
    type_name: str = ""
    """The type on the command line; "" to use the type that the server reports."""
    values: tuple[str, ...] = ()
    timeout: float | None = 10.0
    """Seconds until the server has accepted or rejected the goal; None for no limit."""
    shows_feedback: bool = False
    as_json: bool = False
    remote: Remote = HERE


def run(plan: Plan) -> Exit:
    """Send the goal and wait for its end; Ctrl-C cancels the goal.

    Raises the errors of `ActionClient.send_goal`, InvalidName, InvalidRequest and DefinitionError.
    """
    return asyncio.run(_run(plan))


async def _run(plan: Plan) -> Exit:
    name = quoting.expanded(plan.action, kind="action name")
    if plan.type_name:
        build_request(action_type(plan.type_name).Goal, plan.values)  # before the wait
    loop = asyncio.get_running_loop()
    deadline = None if plan.timeout is None else loop.time() + plan.timeout
    async with plan.remote.node() as node:
        sender = _Sender(plan, node, name, deadline)
        return await sender.run()


class _Sender:
    """Sends the one goal of a command."""

    def __init__(self, plan: Plan, node: Node, name: str, deadline: float | None) -> None:
        self._plan = plan
        self._node = node
        self._name = name
        self._deadline = deadline

    async def run(self) -> Exit:
        self._print("Waiting for an action server to become available...")
        cls = action_type(self._plan.type_name or await self._type_of_server())
        goal = build_request(cls.Goal, self._plan.values)
        client = self._node.create_action_client(cls, self._name)
        if not await client.wait_for_server(self._left()):
            raise await self._unavailable()
        self._print(f"Sending goal:\n     {yaml_of(as_typed(goal), _FULL)}")
        try:
            handle = await self._send(client, goal)
        except GoalRejected as error:
            return self._rejected(error)
        self._print(f"Goal accepted with ID: {handle.goal_id}\n")
        try:
            return await self._finish(handle)
        except asyncio.CancelledError:
            await self._cancel(handle)
            raise

    async def _type_of_server(self) -> str:
        """Wait until a program has the action; returns its type."""
        while True:
            entries = await graph.entries_of(self._plan.remote, self._node)
            found = actions(entries).get(self._name)
            if found is not None and found.servers:
                return next(iter(found.servers.values()))
            left = self._left()
            if left is not None and left <= 0:
                raise await self._unavailable()
            await asyncio.sleep(_POLL if left is None else min(_POLL, left))

    async def _send(self, client: ActionClient[Any, Any, Any], goal: Any) -> GoalHandle[Any, Any]:
        return await client.send_goal(goal, timeout=self._left())

    def _rejected(self, error: GoalRejected) -> Exit:
        """Print the rejection as ros2 does; the reason goes to standard error.

        The exit code says whether the goal had its answer, as in ros2, and not which answer.
        """
        self._print("Goal was rejected.")
        if self._plan.as_json:
            self._print_json({"accepted": False, "reason": error.message})
        else:
            reason = " ".join(error.message.split()) or error.code
            print(f"  hint: {reason}", file=sys.stderr)
        return Exit.DONE

    async def _finish(self, handle: GoalHandle[Any, Any]) -> Exit:
        async for feedback in handle.feedback:
            if self._plan.shows_feedback:
                self._print(f"Feedback:\n    {yaml_of(feedback, _FULL)}")
                if self._plan.as_json:
                    self._print_json({"feedback": srvgen.to_builtins(feedback)})
        state, reason = GoalState.SUCCEEDED, ""
        try:
            result = await handle.result()
        except (GoalAborted, GoalCanceled) as error:
            state, result, reason = handle.state, error.result, error.message
        if result is not None:
            self._print(f"Result:\n    {yaml_of(result, _FULL)}")
        else:
            self._print(f"No result: {reason}\n")
        self._print(f"Goal finished with status: {state.name}")
        if self._plan.as_json:
            shown = None if result is None else srvgen.to_builtins(result)
            facts = {"goal_id": handle.goal_id, "status": state.name, "result": shown}
            self._print_json(facts)
        return Exit.DONE

    async def _cancel(self, handle: GoalHandle[Any, Any]) -> None:
        """Cancel the goal after Ctrl-C."""
        self._print("Canceling goal...")
        try:
            is_accepted = await handle.cancel()
        except TaskRpcError as error:
            self._print(f"Failed to cancel goal: {error}")
        else:
            self._print("Goal canceled." if is_accepted else "Failed to cancel goal")

    async def _unavailable(self) -> ServiceUnavailable:
        from srvgen.definitions.names import did_you_mean

        known = actions(await graph.entries_of(self._plan.remote, self._node))
        known.pop(self._name, None)
        waited = f"(waited {self._plan.timeout:g} s)"
        error = ServiceUnavailable(f"no server offers the action {self._name} {waited}")
        there_are = f"there are {', '.join(known)}" if known else "start an action server first"
        return hinted(error, did_you_mean(self._name, known) or there_are)

    def _left(self) -> float | None:
        if self._deadline is None:
            return None
        return max(0.0, self._deadline - asyncio.get_running_loop().time())

    def _print(self, text: str) -> None:
        if not self._plan.as_json:
            print(text, flush=True)

    def _print_json(self, facts: dict[str, Any]) -> None:
        print(json.dumps(without_nan(facts)), flush=True)
