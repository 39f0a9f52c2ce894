"""Action clients: sending exactly once, deadlines, feedback that is read slowly, lost servers."""

import asyncio

import pytest

import taskrpc
from taskrpc import GoalState
from taskrpc.testing import CallFaults, FaultyNetwork
from tests.core.actions.helpers import (
    Fibonacci,
    Sleeper,
    echo,
    feedback,
    order,
    programs,
    result,
)
from tests.core.transport.helpers import outcome, until

SEND = "/fibonacci/_action/send_goal"
RESULT = "/fibonacci/_action/get_result"


# Sending


@pytest.mark.parametrize("fault", ["lose-response", "cut-connection"])
async def test_a_goal_whose_response_is_lost_runs_once(fault):
    sleeper = Sleeper()
    faults = CallFaults(f"{fault}:first=1,service={SEND}")
    async with programs(sleeper, node={"faults": faults}) as (_, _, client):
        sent = asyncio.ensure_future(outcome(client.send_goal(order(1))))
        handle = await sent
        if fault == "lose-response":  # the connection lives, so only the deadline ends the wait
            assert isinstance(handle, taskrpc.DeadlineExceeded)
        else:
            assert list((await handle.result(60)).sequence) == [1]
        assert sleeper.begun == [1]


async def test_a_goal_is_cancelled_if_its_client_stops_waiting_for_the_decision():
    sleeper = Sleeper()
    faults = CallFaults(f"lose-response:first=2,service={SEND}")
    async with programs(sleeper, node={"faults": faults}) as (_, server, client):
        with pytest.raises(taskrpc.DeadlineExceeded) as caught:
            await client.send_goal(order(50), timeout=2)
        assert caught.value.not_executed is None
        waiting = asyncio.ensure_future(client.send_goal(order(60)))
        await until(lambda: server.status().running == 1)
        await asyncio.sleep(1)
        waiting.cancel()
        await asyncio.sleep(1)
        assert server.status().running == 0
        assert sleeper.begun == [50, 60]


async def test_a_goal_is_canceling_once_the_server_agrees_to_cancel(monkeypatch):
    """Also if the message with the new state arrives after the response."""
    monkeypatch.setattr(taskrpc.ActionClient, "_on_status", lambda client, message: None)
    async with programs(Sleeper()) as (_, _, client):
        handle = await client.send_goal(order(50))
        assert await handle.cancel()
        assert handle.state is GoalState.CANCELING


async def test_a_goal_with_an_id_of_its_own_is_not_cancelled():
    sleeper = Sleeper()
    faults = CallFaults(f"lose-response:first=1,service={SEND}")
    async with programs(sleeper, node={"faults": faults}) as (_, _, client):
        with pytest.raises(taskrpc.DeadlineExceeded):
            await client.send_goal(order(5), timeout=2, goal_id="5" * 32)
        handle = await client.send_goal(order(5), goal_id="5" * 32)
        assert list((await handle.result(60)).sequence) == [5]
        assert sleeper.begun == [5]


async def test_the_timeout_covers_the_decision_of_the_server():
    async def accept(goal):
        await asyncio.sleep(30)
        return True

    async with programs(echo, goal=accept, client={"timeout": 3}) as (_, _, client):
        with pytest.raises(taskrpc.DeadlineExceeded):
            await client.send_goal(order(1))
        assert asyncio.get_running_loop().time() < 4
        assert (await (await client.send_goal(order(1), timeout=None)).result()) == result(1)


async def test_a_wrong_goal_is_refused_before_it_is_sent():
    async with programs(echo) as (_, _, client):
        with pytest.raises(taskrpc.InvalidRequest, match="goal"):
            await client.send_goal(result(1))
        with pytest.raises(taskrpc.InvalidRequest, match=r"goal\.order"):
            await client.send_goal(order("many"))
        with pytest.raises(ValueError, match="goal_id: expected a UUID"):
            await client.send_goal(order(1), goal_id="first")


# Waiting for the result


async def test_a_result_that_comes_too_late_raises_and_the_goal_continues():
    async with programs(Sleeper()) as (_, _, client):
        handle = await client.send_goal(order(5))
        with pytest.raises(taskrpc.DeadlineExceeded, match=r"has not ended within 2 s; it contin"):
            await handle.result(timeout=2)
        waiting = asyncio.ensure_future(handle.result())
        await asyncio.sleep(1)
        waiting.cancel()
        assert await handle.result() == result(5)
        assert await handle.result(timeout=0) == result(5)


async def test_a_goal_survives_lost_connections_of_its_client():
    sleeper = Sleeper()
    with FaultyNetwork() as network:
        async with programs(sleeper) as (_, _, client):
            handle = await client.send_goal(order(20))
            for _ in range(8):
                await asyncio.sleep(2)
                network.cut("client", "server")
            assert await handle.result() == result(20)
    assert sleeper.begun == [20]


async def test_goals_of_a_killed_server_fail_at_once():
    loop = asyncio.get_running_loop()
    with FaultyNetwork() as network:
        async with programs(Sleeper(), concurrency=20) as (_, _, client):
            handles = [await client.send_goal(order(50)) for _ in range(15)]
            await asyncio.sleep(1)
            began = loop.time()
            network.crash("server")
            for handle in handles:
                with pytest.raises(taskrpc.OutcomeUnknown, match="/fibonacci has ended"):
                    await handle.result()
            assert loop.time() - began < 0.1
            assert [each async for each in handles[0].feedback] == []


async def test_a_goal_of_a_server_that_was_replaced_is_unknown():
    with FaultyNetwork() as network:
        async with programs(Sleeper()) as (_, _, client):
            handle = await client.send_goal(order(50))
            async with taskrpc.Node("next", transport="memory", listen="next") as node:
                network.crash("server")
                node.create_action_server(Fibonacci, "fibonacci", echo)
                with pytest.raises(taskrpc.OutcomeUnknown, match="has no such goal"):
                    await handle.result()
                assert await (await client.send_goal(order(2))).result() == result(2)


async def test_a_server_that_is_too_busy_to_wait_for_results_is_asked_again():
    faults = CallFaults(f"busy:first=3,service={RESULT}")
    async with programs(Sleeper(), node={"faults": faults}) as (_, _, client):
        handle = await client.send_goal(order(5))
        assert await handle.result() == result(5)
        assert faults.happened == {"busy": 3}


async def test_a_server_that_always_loses_connections_is_not_asked_for_ever():
    faults = CallFaults(f"busy:service={RESULT}")
    async with programs(Sleeper(), node={"faults": faults}) as (_, _, client):
        handle = await client.send_goal(order(5))
        with pytest.raises(taskrpc.OutcomeUnknown, match="cannot be reached"):
            await handle.result()


@pytest.mark.parametrize("goals", [1, 12])
async def test_a_lost_response_with_a_result_is_requested_again(goals):
    loop = asyncio.get_running_loop()
    faults = CallFaults(f"lose-response:first=3,service={RESULT}")
    async with programs(Sleeper(), node={"faults": faults}, concurrency=goals) as (_, _, client):
        handles = [await client.send_goal(order(60)) for _ in range(goals)]
        await asyncio.gather(*(handle.result() for handle in handles))
        # A goal whose response is lost three times waits for 5, 10 and 20 s.
        assert loop.time() < 60 + 36
        assert faults.happened == {"lose-response": 3}


async def test_a_lost_result_of_a_repeated_goal_is_requested_again():
    kinds = ("slow:0.1s,", "lose-response:")  # of the first and the second call
    faults = CallFaults(*(f"{kind}first=1,service={RESULT}" for kind in kinds))
    goal_id = "0" * 31 + "1"
    async with programs(echo, node={"faults": faults}) as (_, _, client):
        first = await client.send_goal(order(5), goal_id=goal_id)
        await first.result()
        await asyncio.sleep(1)
        # The goal ended long ago, so no further status says that it has ended.
        again = await client.send_goal(order(5), goal_id=goal_id)
        assert again is not first
        await asyncio.wait_for(again.result(), 60)
        assert faults.happened == {"slow": 1, "lose-response": 1}


# Feedback


async def count_up(goal):
    for number in range(goal.request.order):
        goal.publish_feedback(feedback(number))
        await asyncio.sleep(0.1)
    return result()


async def test_a_program_that_reads_slowly_gets_the_newest_feedback():
    async with programs(count_up, client={"feedback_depth": 3}) as (_, _, client):
        handle = await client.send_goal(order(10))
        await handle.result()
        await asyncio.sleep(1)
        assert [each.sequence[0] async for each in handle.feedback] == [7, 8, 9]
        assert handle.feedback.dropped == 7
        assert [each async for each in handle.feedback] == []


async def test_unread_feedback_does_not_delay_the_goal():
    async with programs(count_up) as (_, _, client):
        handle = await client.send_goal(order(1000))
        assert await handle.result() == result()


async def test_two_tasks_may_read_the_feedback_and_each_message_is_read_once():
    read = []

    async def reader(handle):
        async for each in handle.feedback:
            read.append(each.sequence[0])
            await asyncio.sleep(0.05)

    async with programs(count_up) as (_, _, client):
        handle = await client.send_goal(order(10))
        await asyncio.gather(reader(handle), reader(handle))
    assert read == list(range(10))


# The end of the client


async def test_a_destroyed_client_leaves_its_goals_alone():
    sleeper = Sleeper()
    async with programs(sleeper, concurrency=20) as (_, server, client):
        handles = [await client.send_goal(order(5)) for _ in range(12)]
        await until(lambda: len(sleeper.begun) == 12)
        client.destroy()
        client.destroy()
        for handle in handles:
            with pytest.raises(taskrpc.TaskRpcError, match="the action client of /fibonacci was"):
                await handle.result()
            assert [each async for each in handle.feedback] == []
        with pytest.raises(taskrpc.TaskRpcError, match="the action client of /fibonacci was"):
            await client.wait_for_server(1)
        await asyncio.sleep(1)
        assert server.status().running == 12
        assert handles[0].state is GoalState.UNKNOWN


async def test_a_client_waits_for_a_server_that_starts_later():
    async with taskrpc.Node("client", transport="memory", listen="client") as calling:
        client = calling.create_action_client(Fibonacci, "fibonacci")
        assert not await client.wait_for_server(5)
        with pytest.raises(ValueError, match=r"wait_for_server: timeout: expected seconds, .* '3'"):
            await client.wait_for_server("3")
        waiting = asyncio.ensure_future(client.wait_for_server(60))
        async with taskrpc.Node("server", transport="memory", listen="server") as node:
            node.create_action_server(Fibonacci, "fibonacci", echo)
            assert await waiting
            assert client.server_is_ready()
            assert await (await client.send_goal(order(1))).result() == result(1)


async def test_clients_of_a_namespace_and_of_remapped_names_find_the_action():
    async with taskrpc.Node("robot", namespace="/lab", transport="memory") as node:
        server = node.create_action_server(Fibonacci, "~/fibonacci", echo)
        assert server.action_name == "/lab/robot/fibonacci"
        client = node.create_action_client(Fibonacci, "/lab/robot/fibonacci")
        assert client.action_name == "/lab/robot/fibonacci"
        assert await (await client.send_goal(order(1))).result() == result(1)


async def test_an_invalid_name_is_called_the_name_of_an_action():
    async with taskrpc.Node("robot", transport="memory") as node:
        for name in ("/a b", "", "a//b"):
            with pytest.raises(taskrpc.InvalidName, match="Invalid action name"):
                node.create_action_client(Fibonacci, name)
            with pytest.raises(taskrpc.InvalidName, match="Invalid action name"):
                node.create_action_server(Fibonacci, name, echo)
