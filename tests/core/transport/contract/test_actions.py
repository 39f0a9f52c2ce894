"""Contract of every transport: actions, which consist of services and topics."""

import asyncio
import logging

import pytest

import srvgen
import taskrpc
from taskrpc import GoalState
from tests.core.transport.helpers import outcome, until

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
SOON = 30
"""Seconds; only a test that fails waits so long."""


def order(count):
    return Fibonacci.Goal(order=count)


def sequence_of(count):
    sequence = [0, 1]
    for _ in range(count - 1):
        sequence.append(sequence[-1] + sequence[-2])
    return sequence


async def fibonacci(goal):
    """Publish each further number as feedback; end soon after a cancellation."""
    for count in range(1, goal.request.order + 1):
        if goal.is_cancel_requested:
            return goal.canceled(Fibonacci.Result(sequence=sequence_of(count)))
        goal.publish_feedback(Fibonacci.Feedback(sequence=sequence_of(count)))
        await asyncio.sleep(0.001)
    return Fibonacci.Result(sequence=sequence_of(goal.request.order))


class Held:
    """A callback that holds each goal until the test lets it end, or until it is cancelled."""

    def __init__(self):
        self.begun = []
        self.release = asyncio.Event()

    async def __call__(self, goal):
        self.begun.append(goal.request.order)
        waits = [
            asyncio.ensure_future(self.release.wait()),
            asyncio.ensure_future(goal.wait_for_cancel()),
        ]
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for wait in waits:
                wait.cancel()
        result = Fibonacci.Result(sequence=[goal.request.order])
        return goal.canceled(result) if goal.is_cancel_requested else result


async def served(net, execute=fibonacci, **options):
    """A server of an action, and its client, each with its own endpoint."""
    server = await net.node("server")
    server.create_action_server(Fibonacci, "fibonacci", execute, **options)
    client = (await net.node("client")).create_action_client(Fibonacci, "fibonacci")
    assert await client.wait_for_server(SOON)
    return server, client


async def test_a_goal_gets_its_feedback_and_its_result(net):
    _, client = await served(net)
    handle = await client.send_goal(order(5))
    feedback = [list(each.sequence) async for each in handle.feedback]
    assert feedback == [sequence_of(count) for count in range(1, 6)]
    assert list((await handle.result()).sequence) == sequence_of(5)
    assert handle.state is GoalState.SUCCEEDED


async def test_goals_at_once_get_each_their_own_feedback(net):
    _, client = await served(net, concurrency=4)
    handles = await asyncio.gather(*[client.send_goal(order(count)) for count in range(1, 9)])
    for count, handle in enumerate(handles, 1):
        assert list((await handle.result(SOON)).sequence) == sequence_of(count)
        assert [len(each.sequence) async for each in handle.feedback] == [*range(2, count + 2)]


async def test_a_cancelled_goal_ends_as_cancelled_with_its_result(net):
    _, client = await served(net, Held())
    handle = await client.send_goal(order(7))
    await until(lambda: handle.state is GoalState.EXECUTING)
    assert await handle.cancel()
    with pytest.raises(taskrpc.GoalCanceled) as caught:
        await handle.result(SOON)
    assert list(caught.value.result.sequence) == [7]
    assert handle.state is GoalState.CANCELED
    assert not await handle.cancel()


async def test_a_rejected_goal_does_not_begin(net):
    held = Held()

    def accept(goal):
        if goal.order > 9:
            raise taskrpc.HandlerError("OUT_OF_RANGE", "at most 9")
        return goal.order > 0

    _, client = await served(net, held, goal=accept)
    with pytest.raises(taskrpc.GoalRejected, match="the server of /fibonacci rejected the goal"):
        await client.send_goal(order(0))
    with pytest.raises(taskrpc.GoalRejected, match="at most 9") as caught:
        await client.send_goal(order(10))
    assert caught.value.code is taskrpc.Code.OUT_OF_RANGE
    assert caught.value.not_executed
    assert held.begun == []


async def test_a_callback_that_raises_aborts_the_goal(net, caplog):
    caplog.set_level(logging.ERROR)

    async def execute(goal):
        if goal.request.order == 1:
            raise taskrpc.HandlerError("NOT_FOUND", "no such place")
        raise ValueError("secret")

    _, client = await served(net, execute)
    handle = await client.send_goal(order(1))
    with pytest.raises(taskrpc.GoalAborted, match="no such place") as caught:
        await handle.result(SOON)
    assert caught.value.code is taskrpc.Code.NOT_FOUND
    handle = await client.send_goal(order(2))
    with pytest.raises(taskrpc.GoalAborted) as caught:
        await handle.result(SOON)
    text = f"the callback failed; see the server's log, goal {handle.goal_id}"
    assert str(caught.value) == text
    assert f"goal {handle.goal_id} of /fibonacci failed" in caplog.text


async def test_a_goal_that_the_server_aborts_has_a_result(net):
    async def execute(goal):
        return goal.abort(Fibonacci.Result(sequence=[1, 2]))

    _, client = await served(net, execute)
    handle = await client.send_goal(order(1))
    with pytest.raises(taskrpc.GoalAborted, match="was aborted") as caught:
        await handle.result(SOON)
    assert list(caught.value.result.sequence) == [1, 2]
    assert caught.value.not_executed is False


async def test_goals_of_a_server_that_ends_fail_at_once(net):
    server, client = await served(net, Held(), concurrency=20)
    handles = [await client.send_goal(order(count)) for count in range(20)]
    loop = asyncio.get_running_loop()
    await server.destroy()
    began = loop.time()
    for handle in handles:
        error = await outcome(handle.result(SOON))
        assert isinstance(error, taskrpc.OutcomeUnknown), error
        assert handle.state is GoalState.UNKNOWN
    assert loop.time() - began < SOON / 3


async def test_a_repeated_goal_id_runs_once(net):
    held = Held()
    _, client = await served(net, held)
    goal_id = "0123456789abcdef0123456789abcdef"
    first = await client.send_goal(order(3), goal_id=goal_id)
    again = await client.send_goal(order(3), goal_id=goal_id)
    other = (await net.node("other")).create_action_client(Fibonacci, "fibonacci")
    assert await other.wait_for_server(SOON)
    third = await other.send_goal(order(3), goal_id=goal_id)
    with pytest.raises(taskrpc.GoalRejected, match="another goal was sent with the id 0123"):
        await other.send_goal(order(4), goal_id=goal_id)
    held.release.set()
    for handle in (first, again, third):
        assert list((await handle.result(SOON)).sequence) == [3]
    late = await other.send_goal(order(3), goal_id=goal_id)
    assert list((await late.result(SOON)).sequence) == [3]
    assert held.begun == [3]


async def test_more_goals_than_places_for_waiting_calls_all_get_their_results(net):
    held = Held()
    _, client = await served(net, held, concurrency=100)
    slow = [await client.send_goal(order(count)) for count in range(10)]
    await until(lambda: len(held.begun) == 10)
    # The places are taken by goals that do not end; only the status reports the others' end.
    late = await client.send_goal(order(99))
    await until(lambda: 99 in held.begun)
    assert await late.cancel()
    error = await outcome(late.result(SOON))
    assert isinstance(error, taskrpc.GoalCanceled)
    held.release.set()
    for count, handle in enumerate(slow):
        assert list((await handle.result(SOON)).sequence) == [count]


async def test_without_a_server_a_goal_fails_at_once(net):
    client = (await net.node("client")).create_action_client(Fibonacci, "fibonacci")
    assert not client.server_is_ready()
    assert not await client.wait_for_server(0.05)
    with pytest.raises(taskrpc.ServiceUnavailable):
        await client.send_goal(order(1))
