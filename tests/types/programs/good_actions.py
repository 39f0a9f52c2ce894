"""Every way to offer and use an action, with and without blocking."""

import asyncio
from typing import TypeAlias, TypeVar

import srvgen
import taskrpc
from taskrpc import sync

srvgen.install_import_hook()

from my_interfaces.action import Count

CountGoal: TypeAlias = taskrpc.ServerGoal[Count.Goal, Count.Result, Count.Feedback]
GoalT = TypeVar("GoalT", bound=taskrpc.Msg)
ResultT = TypeVar("ResultT", bound=taskrpc.Msg)
FeedbackT = TypeVar("FeedbackT", bound=taskrpc.Msg)


async def count(goal: CountGoal) -> Count.Result:
    for reached in range(goal.request.target):
        if goal.is_cancel_requested:
            return goal.canceled(Count.Result(summary="cancelled"))
        goal.publish_feedback(Count.Feedback(reached=reached))
        await asyncio.sleep(1)
    return Count.Result(summary="done")


def count_at_once(goal: CountGoal) -> Count.Result:
    return goal.abort(Count.Result(summary=str(goal.request.target)))


def accept(goal: Count.Goal) -> bool:
    return goal.target < 10


async def accept_slowly(goal: Count.Goal) -> bool:
    return goal.target < 10


def cancel(goal: CountGoal) -> bool:
    return goal.state is taskrpc.GoalState.EXECUTING


class Counter:
    def __init__(self, node: taskrpc.Node) -> None:
        self.server: taskrpc.ActionServer = node.create_action_server(Count, "count", self.count)
        self.client: taskrpc.ActionClient[Count.Goal, Count.Result, Count.Feedback]
        self.client = node.create_action_client(Count, "count")

    async def count(self, goal: CountGoal) -> Count.Result:
        handle = await self.client.send_goal(goal.request)
        return await handle.result()


async def run_goal(
    node: taskrpc.Node, action: type[taskrpc.Action[GoalT, ResultT, FeedbackT]], goal: GoalT
) -> ResultT:
    handle = await node.create_action_client(action, "any").send_goal(goal)
    return await handle.result()


async def main() -> None:
    async with taskrpc.Node("a") as node:
        node.create_action_server(Count, "count", count, goal=accept, cancel=cancel)
        node.create_action_server(Count, "at_once", count_at_once, goal=accept_slowly)
        node.create_action_server(Count, "lambda", lambda goal: Count.Result(summary="done"))
        client = node.create_action_client(Count, "count", feedback_depth=3)
        handle = await client.send_goal(Count.Goal(target=3), timeout=2.0)
        async for feedback in handle.feedback:
            reached: int = feedback.reached
            print(reached)
        words: list[str] = (await handle.result(timeout=5)).summary.split()
        cancelled: bool = await handle.cancel()
        print(words, cancelled, (await run_goal(node, Count, Count.Goal())).summary)
        try:
            await handle.result()
        except taskrpc.GoalFailed as error:
            print(error.code, error.result)


with sync.Node("b") as blocking:
    blocking.create_action_server(Count, "count", count_at_once)
    blocking_client = blocking.create_action_client(Count, "count")
    blocking_handle = blocking_client.send_goal(Count.Goal(target=1))
    for step in blocking_handle.feedback:
        print(step.reached + 1)
    print(blocking_handle.result().summary.upper())

taskrpc.run(main())
