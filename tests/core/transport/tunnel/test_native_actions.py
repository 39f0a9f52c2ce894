"""A program that is not taskrpc's uses an action of ours: it gets ROS's answers, never an error."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc import GoalState
from taskrpc.actions.messages import ActionMessages
from tests.core.transport.tunnel.test_native import native_call

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
MESSAGES = ActionMessages(Fibonacci)
NAME = "/fibonacci/_action"


async def send(engine, number, key=None):
    goal_id = MESSAGES.goal_id((key or bytes([number])) * 16)
    request = MESSAGES.send_goal.Request(goal_id=goal_id, goal=Fibonacci.Goal(order=number))
    return await native_call(engine, f"{NAME}/send_goal", request, MESSAGES.send_goal)


async def get_result(engine, number):
    request = MESSAGES.get_result.Request(goal_id=MESSAGES.goal_id(bytes([number]) * 16))
    return await native_call(engine, f"{NAME}/get_result", request, MESSAGES.get_result)


async def execute(goal):
    if goal.request.order == 3:
        raise taskrpc.HandlerError("NOT_FOUND", "no such number")
    return Fibonacci.Result(sequence=[goal.request.order])


def accept(goal):
    if goal.order == 2:
        raise taskrpc.HandlerError("OUT_OF_RANGE", "not two")
    return goal.order != 1


@pytest.fixture
async def engine(programs):
    node = await programs.node("server")
    node.create_action_server(Fibonacci, "fibonacci", execute, goal=accept)
    engine = await programs.foreign()
    await asyncio.sleep(1)
    return engine


@pytest.mark.parametrize("number", [1, 2])
async def test_a_rejected_goal_is_answered_as_in_ros(engine, number):
    assert not (await send(engine, number)).accepted
    assert (await get_result(engine, number)).status == GoalState.UNKNOWN


async def test_a_goal_whose_callback_raises_is_answered_as_aborted(engine):
    assert (await send(engine, 3)).accepted
    response = await get_result(engine, 3)
    assert (response.status, list(response.result.sequence)) == (GoalState.ABORTED, [])


async def test_a_goal_gets_its_result_and_its_id_cannot_be_used_for_another(engine):
    response = await send(engine, 4)
    assert response.accepted
    assert response.stamp.sec > 0
    response = await get_result(engine, 4)
    assert (response.status, list(response.result.sequence)) == (GoalState.SUCCEEDED, [4])
    assert not (await send(engine, 5, key=bytes([4]))).accepted
