"""The native API and `rclpy.action` understand each other, over real sockets."""

import asyncio
import threading

import pytest

import taskrpc
from taskrpc.ros.packages.rclpy.action import ActionClient, ActionServer, CancelResponse
from taskrpc.ros.packages.rclpy.callback_groups import ReentrantCallbackGroup
from taskrpc.ros.packages.rclpy.executors import MultiThreadedExecutor
from tests.ros.packages.rclpy.action.actions import Fibonacci, GoalStatus, ended, order, result
from tests.ros.packages.rclpy.living import living

pytestmark = pytest.mark.real_time


class Native:
    """Runs a coroutine of the native API on a thread; `done` once it has returned."""

    def __init__(self, coroutine):
        self.value = self.error = None
        self._thread = threading.Thread(target=self._run, args=(coroutine,))
        self._thread.start()

    @property
    def done(self):
        return not self._thread.is_alive()

    def _run(self, coroutine):
        try:
            self.value = asyncio.run(coroutine)
        except BaseException as error:
            self.error = error


def test_a_native_client_uses_an_rclpy_server():
    cancelled = threading.Event()

    def execute(goal):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[1]))
        if goal.request.order == 9:
            while not goal.is_cancel_requested:
                cancelled.wait(0.001)
            goal.canceled()
        elif goal.request.order == 6:
            goal.abort()
        else:
            goal.succeed()
        return result(goal.request.order)

    async def use():
        async with taskrpc.Node("native") as node:
            client = node.create_action_client(Fibonacci, "fibonacci")
            assert await client.wait_for_server(30)
            handle = await client.send_goal(order(5))
            feedback = [list(each.sequence) async for each in handle.feedback]
            outcomes = [feedback, list((await handle.result()).sequence)]
            for number in (6, 9):
                handle = await client.send_goal(order(number))
                if number == 9:
                    outcomes.append(await handle.cancel())
                try:
                    await handle.result()
                except taskrpc.GoalFailed as error:
                    outcomes.append((type(error).__name__, list(error.result.sequence)))
            return outcomes

    with living() as world:
        node = world.node("served")
        ActionServer(
            node,
            Fibonacci,
            "fibonacci",
            execute,
            callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )
        pool = MultiThreadedExecutor(2, context=world.context)
        pool.add_node(node)
        native = Native(use())
        while not native.done:
            pool.spin_once(0.05)
        pool.shutdown()
    assert native.error is None, native.error
    assert native.value == [[[1]], [5], ("GoalAborted", [6]), True, ("GoalCanceled", [9])]


def test_an_rclpy_client_uses_a_native_server():
    ending = threading.Event()

    async def execute(goal):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[1]))
        if goal.request.order == 9:
            await goal.wait_for_cancel()
            return goal.canceled(result(9))
        return result(goal.request.order)

    async def serve():
        async with taskrpc.Node("native") as node:
            node.create_action_server(Fibonacci, "fibonacci", execute, goal=lambda g: g.order < 50)
            while not ending.is_set():
                await asyncio.sleep(0.01)

    native = Native(serve())
    with living() as world:
        client = ActionClient(world.node("calling"), Fibonacci, "fibonacci")
        assert client.wait_for_server(30)
        messages = []
        handle = world.answer(client.send_goal_async(order(5), feedback_callback=messages.append))
        world.spin_until(lambda: messages)
        response = world.answer(handle.get_result_async())
        assert ended(response) == (GoalStatus.STATUS_SUCCEEDED, [5])
        assert not world.answer(client.send_goal_async(order(50))).accepted
        handle = world.answer(client.send_goal_async(order(9)))
        assert len(world.answer(handle.cancel_goal_async()).goals_canceling) == 1
        response = world.answer(handle.get_result_async())
        assert ended(response) == (GoalStatus.STATUS_CANCELED, [9])
        ending.set()
        world.spin_until(lambda: native.done)
    assert native.error is None, native.error
