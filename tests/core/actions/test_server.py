"""Action servers: which goals run when, and what becomes of them."""

import asyncio
import contextlib
import gc
import re
import threading
import time

import pytest

import srvgen
import taskrpc
from taskrpc import GoalState, QoS
from taskrpc import node as module_of_node
from taskrpc.actions import server as module
from taskrpc.actions.messages import ActionMessages, states_in
from taskrpc.actions.states import InvalidTransition
from tests.core.actions.helpers import (
    Fibonacci,
    Sleeper,
    echo,
    feedback,
    order,
    programs,
    result,
    wait_for_cancel,
)
from tests.core.transport.helpers import outcome, until

LATCHED = QoS(1, durability="transient_local")


async def ending(handle, timeout=60):
    """Return the result's numbers, or the error."""
    ended = await outcome(handle.result(timeout))
    return list(ended.sequence) if isinstance(ended, Fibonacci.Result) else ended


# The order of goals


async def test_one_goal_runs_at_a_time_in_the_order_of_arrival():
    sleeper = Sleeper()
    async with programs(sleeper) as (_, server, client):
        handles = [await client.send_goal(order(number)) for number in (3, 2, 1)]
        await asyncio.sleep(1)
        assert sleeper.begun == [3]
        assert [handle.state for handle in handles] == [
            GoalState.EXECUTING,
            GoalState.ACCEPTED,
            GoalState.ACCEPTED,
        ]
        assert (server.status().running, server.status().waiting) == (1, 2)
        assert [await ending(handle) for handle in handles] == [[3], [2], [1]]
        assert asyncio.get_running_loop().time() < 7


async def test_concurrency_is_the_number_of_goals_that_run_at_a_time():
    sleeper = Sleeper()
    async with programs(sleeper, concurrency=2) as (_, _, client):
        handles = [await client.send_goal(order(number)) for number in (5, 1, 2)]
        await asyncio.sleep(0.5)
        assert sleeper.begun == [5, 1]
        await handles[1].result()
        assert await ending(handles[2], 2.1) == [2]


async def test_a_callback_may_be_plain():
    async with programs(lambda goal: result(7)) as (_, _, client):
        handle = await client.send_goal(order(1))
        assert await ending(handle) == [7]


async def test_when_too_many_goals_wait_more_are_rejected(monkeypatch):
    monkeypatch.setattr(module, "MOST_WAITING", 2)
    async with programs(Sleeper()) as (_, _, client):
        handles = [await client.send_goal(order(9))]
        await until(lambda: handles[0].state is GoalState.EXECUTING)
        handles += [await client.send_goal(order(9)) for _ in range(2)]
        with pytest.raises(taskrpc.GoalRejected, match="2 goals of /fibonacci wait already") as no:
            await client.send_goal(order(9))
        assert no.value.code is taskrpc.Code.RESOURCE_EXHAUSTED
        await handles[1].cancel()
        await client.send_goal(order(9))


# Callbacks


async def test_a_plain_callback_may_run_in_a_thread():
    threads = []

    def execute(goal):
        threads.append(threading.current_thread())
        goal.publish_feedback(feedback(1))
        return result(goal.request.order)

    async with programs(execute, threaded=True) as (_, _, client):
        handle = await client.send_goal(order(4))
        assert await ending(handle) == [4]
        assert [list(each.sequence) async for each in handle.feedback] == [[1]]
    assert threads[0] is not threading.main_thread()


@pytest.mark.real_time
async def test_a_callback_that_blocks_the_event_loop_is_named(caplog):
    def execute(goal):
        time.sleep(0.3)
        return result()

    async with programs(execute) as (_, _, client):
        await (await client.send_goal(order(1))).result()
    assert "the callback of /fibonacci held the event loop" in caplog.text


@pytest.mark.parametrize(
    ("returned", "problem"),
    [
        (None, "returned None; the callback must return a example_interfaces/action/Fibonacci_R"),
        ("done", "returned a str; the callback must return a"),
        (result("many"), "the result cannot be sent: sequence"),
    ],
)
async def test_an_invalid_result_aborts_the_goal_and_the_log_says_why(returned, problem, caplog):
    async with programs(lambda goal: returned) as (_, _, client):
        error = await ending(await client.send_goal(order(1)))
        assert isinstance(error, taskrpc.GoalAborted)
        assert "see the server's log" in str(error)
    assert problem in caplog.text


async def test_only_a_cancelled_goal_may_end_as_cancelled(caplog):
    async def execute(goal):
        with pytest.raises(InvalidTransition, match="expected CANCEL_GOAL or"):
            goal.canceled(result())
        return result(1)

    async with programs(execute) as (_, _, client):
        assert await ending(await client.send_goal(order(1))) == [1]


async def test_a_cancelled_goal_may_still_succeed_or_abort():
    async def execute(goal):
        await goal.wait_for_cancel()
        return result(1) if goal.request.order == 1 else goal.abort(result(2))

    async with programs(execute) as (_, _, client):
        for number in (1, 2):
            handle = await client.send_goal(order(number))
            await until(lambda handle=handle: handle.state is GoalState.EXECUTING)
            assert await handle.cancel()
            await ending(handle)
            assert handle.state is (GoalState.SUCCEEDED if number == 1 else GoalState.ABORTED)


async def test_feedback_of_another_type_and_feedback_after_the_end_are_refused():
    goals = []

    async def execute(goal):
        goals.append(goal)
        with pytest.raises(taskrpc.InvalidRequest, match="feedback: expected"):
            goal.publish_feedback(result(1))
        with pytest.raises(taskrpc.InvalidRequest, match="sequence"):
            goal.publish_feedback(feedback("many"))
        return result(1)

    async with programs(execute) as (_, _, client):
        handle = await client.send_goal(order(1))
        assert await ending(handle) == [1]
        with pytest.raises(taskrpc.TaskRpcError, match=f"the goal {handle.goal_id} has ended"):
            goals[0].publish_feedback(feedback(1))
        assert (goals[0].goal_id, goals[0].state) == (handle.goal_id, GoalState.SUCCEEDED)


async def test_a_callback_that_is_cancelled_by_the_program_aborts_its_goal(caplog):
    async def execute(goal):
        raise asyncio.CancelledError

    async with programs(execute) as (_, _, client):
        assert isinstance(await ending(await client.send_goal(order(1))), taskrpc.GoalAborted)
        assert isinstance(await ending(await client.send_goal(order(2))), taskrpc.GoalAborted)
    assert [line.partition("failed")[2] for line in caplog.messages] == [
        ": its callback was cancelled",
        ": its callback was cancelled",
    ]
    assert {record.exc_info for record in caplog.records} == {None}


# Accepting goals and cancellations


async def test_the_program_decides_once_about_a_goal_id():
    asked = []

    async def accept(goal):
        asked.append(goal.order)
        await asyncio.sleep(1)
        return goal.order > 1

    async with programs(echo, goal=accept) as (_, _, client):
        ids = [f"{number:032x}" for number in (1, 2)]
        sent = [client.send_goal(order(n), goal_id=ids[n - 1]) for n in (1, 2) for _ in range(3)]
        outcomes = await asyncio.gather(*map(outcome, sent))
        assert sorted(asked) == [1, 2]
        assert all(isinstance(each, taskrpc.GoalRejected) for each in outcomes[:3])
        assert [await ending(handle) for handle in outcomes[3:]] == [[2]] * 3


async def test_an_accepting_callback_that_raises_rejects_the_goal(caplog):
    def accept(goal):
        raise ValueError("secret")

    async with programs(echo, goal=accept) as (_, _, client):
        with pytest.raises(taskrpc.GoalRejected, match="see the server's log, goal") as caught:
            await client.send_goal(order(1))
    assert "secret" not in str(caught.value)
    assert "secret" in caplog.text


@pytest.mark.parametrize("is_async", [False, True])
async def test_a_missing_return_of_a_deciding_function_is_explained(caplog, is_async):
    async def nothing(_):
        """Return no decision."""

    decide = nothing if is_async else lambda _: None
    async with programs(Sleeper(), goal=decide) as (_, _, client):
        with pytest.raises(taskrpc.GoalRejected):
            await client.send_goal(order(1))
    async with programs(Sleeper(), cancel=decide) as (_, _, client):
        handle = await client.send_goal(order(1))
        assert not await handle.cancel()
    for name in ("goal", "cancel"):
        expected = f"`{name}=`: expected a function that returns True or False, got None"
        assert expected in caplog.text


async def test_the_reason_of_a_rejection_is_logged(caplog):
    def accept(goal):
        raise taskrpc.HandlerError("OUT_OF_RANGE", "at most 20 numbers")

    caplog.set_level("INFO", "taskrpc.server")
    async with programs(echo, goal=accept) as (_, _, client):
        with pytest.raises(taskrpc.GoalRejected, match="at most 20 numbers"):
            await client.send_goal(order(21))
    assert re.search("rejected goal [0-9a-f]{32} of /fibonacci: .*at most 20 numbers", caplog.text)


async def test_a_waiting_goal_that_is_cancelled_ends_at_once_and_never_begins():
    sleeper = Sleeper()
    async with programs(sleeper) as (_, _, client):
        await client.send_goal(order(5))
        waiting = await client.send_goal(order(1))
        assert await waiting.cancel()
        error = await ending(waiting, 1)
        assert isinstance(error, taskrpc.GoalCanceled)
        await asyncio.sleep(10)
        assert sleeper.begun == [5]


@pytest.mark.parametrize("refuses", ["returns False", "raises"])
async def test_the_program_may_refuse_a_cancellation(refuses, caplog):
    async def cancel(goal):
        if refuses == "raises":
            raise ValueError("secret")
        return goal.request.order != 1

    async with programs(Sleeper(), cancel=cancel) as (_, _, client):
        handle = await client.send_goal(order(1))
        assert not await handle.cancel()
        assert await ending(handle) == [1]
    assert ("secret" in caplog.text) == (refuses == "raises")


async def test_a_goal_that_ends_while_the_program_decides_is_not_cancelled():
    async def cancel(goal):
        await asyncio.sleep(2)
        return True

    async with programs(Sleeper(), cancel=cancel) as (_, _, client):
        handle = await client.send_goal(order(1))
        assert not await handle.cancel()
        assert handle.state is GoalState.SUCCEEDED


async def test_a_repeated_cancellation_is_accepted_again():
    async def execute(goal):
        await goal.wait_for_cancel()
        await asyncio.sleep(1)
        return goal.canceled(result())

    async with programs(execute) as (_, _, client):
        handle = await client.send_goal(order(1))
        assert await handle.cancel()
        assert await handle.cancel()
        assert isinstance(await ending(handle), taskrpc.GoalCanceled)


async def test_a_request_without_an_id_cancels_all_goals():
    messages = ActionMessages(Fibonacci)
    service = "/fibonacci/_action/cancel_goal"
    async with programs(wait_for_cancel, concurrency=2) as (node, _, client):
        handles = [await client.send_goal(order(number)) for number in range(3)]
        canceller = node.create_client(messages.cancel_goal, service)
        response = await canceller.call(messages.cancel_goal.Request())
        assert (response.return_code, len(response.goals_canceling)) == (0, 3)
        for handle in handles:
            assert isinstance(await ending(handle), taskrpc.GoalCanceled)
        unknown = messages.cancel_goal.Request(goal_info=messages.goal_info(b"x" * 16))
        assert (await canceller.call(unknown)).return_code == 2
        ended = messages.goal_info(bytes.fromhex(handles[0].goal_id))
        request = messages.cancel_goal.Request(goal_info=ended)
        assert (await canceller.call(request)).return_code == 3


# Results and status


async def test_a_result_is_kept_for_the_stated_time():
    async with programs(echo, result_timeout=60) as (node, _, client):
        first = await client.send_goal(order(1), goal_id="1" * 32)
        assert await ending(first) == [1]
        await asyncio.sleep(59)
        assert await ending(await client.send_goal(order(1), goal_id="1" * 32)) == [1]
        await asyncio.sleep(2)
        messages = ActionMessages(Fibonacci)
        results = node.create_client(messages.get_result, "/fibonacci/_action/get_result")
        request = messages.get_result.Request(goal_id=messages.goal_id(b"\x11" * 16))
        assert (await results.call(request)).status == GoalState.UNKNOWN


async def test_the_status_lists_all_goals_for_late_subscriptions_too():
    async with programs(Sleeper(), result_timeout=30) as (node, _, client):
        handles = [await client.send_goal(order(number)) for number in (1, 9)]
        await handles[0].result()
        seen = []
        node.create_subscription(
            ActionMessages(Fibonacci).status, "/fibonacci/_action/status", seen.append, LATCHED
        )
        await until(lambda: seen)
        ids = [bytes.fromhex(handle.goal_id) for handle in handles]
        assert states_in(seen[-1])[ids[0]] is GoalState.SUCCEEDED
        await until(lambda: states_in(seen[-1])[ids[1]] is GoalState.EXECUTING)
        await asyncio.sleep(31)
        assert ids[0] not in states_in(seen[-1])


async def test_with_many_goals_the_status_is_published_less_often(monkeypatch):
    monkeypatch.setattr(module, "MANY_GOALS", 3)
    async with programs(echo) as (node, _, client):
        seen = []
        node.create_subscription(
            ActionMessages(Fibonacci).status, "/fibonacci/_action/status", seen.append, 1000
        )
        handles = [await client.send_goal(order(number)) for number in range(20)]
        for handle in handles:
            await handle.result()
        await asyncio.sleep(1)
        assert len(seen) < 25
        assert set(states_in(seen[-1]).values()) == {GoalState.SUCCEEDED}
        assert len(states_in(seen[-1])) == 20


# The end of the server


async def test_a_destroyed_server_completes_running_goals_and_aborts_waiting_goals():
    sleeper = Sleeper()
    async with programs(sleeper) as (_, server, client):
        runs, waits = [await client.send_goal(order(number)) for number in (3, 1)]
        await until(lambda: sleeper.begun)
        server.destroy()
        server.destroy()
        error = await ending(waits)
        assert isinstance(error, taskrpc.GoalAborted)
        assert error.code is taskrpc.Code.UNAVAILABLE
        assert error.not_executed
        assert not server.finished.done()
        with pytest.raises(taskrpc.ServiceUnavailable):
            await client.send_goal(order(1))
        assert await ending(runs) == [3]
        await server.finished
        assert sleeper.begun == [3]


async def test_during_a_drain_goals_can_be_cancelled():
    async with programs(Sleeper()) as (node, _, client):
        handle = await client.send_goal(order(20))
        draining = asyncio.ensure_future(node.drain())
        await asyncio.sleep(1)
        assert await handle.cancel()
        assert isinstance(await ending(handle, 1), taskrpc.GoalCanceled)
        await draining


async def test_a_node_that_drains_waits_for_its_goals():
    async with programs(Sleeper()) as (node, _, client):
        handle = await client.send_goal(order(3))
        await until(lambda: handle.state is GoalState.EXECUTING)
        await node.drain()
        assert await ending(handle, 1) == [3]


async def test_a_goal_that_is_being_decided_when_the_server_ends_is_rejected():
    async def accept(goal):
        await asyncio.sleep(1)
        return True

    async with programs(echo, goal=accept) as (_, server, client):
        sent = asyncio.ensure_future(outcome(client.send_goal(order(1))))
        await asyncio.sleep(0.5)
        server.destroy()
        error = await sent
        assert isinstance(error, taskrpc.GoalRejected)
        assert error.code is taskrpc.Code.UNAVAILABLE


async def test_the_callbacks_of_a_destroyed_node_are_cancelled():
    ended = []

    async def execute(goal):
        try:
            await asyncio.sleep(100)
        finally:
            ended.append(goal.is_cancel_requested)

    async with programs(execute) as (node, server, client):
        handle = await client.send_goal(order(1))
        await until(lambda: handle.state is GoalState.EXECUTING)
        await node.destroy()
        assert isinstance(await ending(handle), taskrpc.OutcomeUnknown)
        assert ended == [True]
        assert server.finished.done()


# The end of the program: `spin` stops the server


@contextlib.asynccontextmanager
async def stopped_programs(execute, **options):
    """A goal that runs when the program is told to end: yields its handle and the spin."""
    async with programs(execute, **options) as (node, _, client):
        spinning = asyncio.ensure_future(node.spin())
        handle = await client.send_goal(order(1000))
        await until(lambda: handle.state is GoalState.EXECUTING)
        spinning.cancel()  # as a signal does
        yield handle, spinning
        await asyncio.wait([spinning])


async def test_a_program_that_ends_cancels_its_goals():
    began = asyncio.get_running_loop().time()
    async with stopped_programs(Sleeper()) as (handle, spinning):
        error = await ending(handle)
        assert isinstance(error, taskrpc.GoalCanceled)
        assert list(error.result.sequence) == [1000]
        await asyncio.wait([spinning])
        assert asyncio.get_running_loop().time() - began < module_of_node.GOAL_GRACE


async def test_a_callback_that_ignores_the_end_is_cancelled_after_the_grace(caplog):
    ended = []

    async def execute(goal):
        try:
            await asyncio.sleep(100)
        finally:
            ended.append(goal.state)

    async with stopped_programs(execute) as (handle, spinning):
        began = asyncio.get_running_loop().time()
        error = await ending(handle)
        assert asyncio.get_running_loop().time() - began == pytest.approx(2.0, abs=0.1)
        await asyncio.wait([spinning])
    assert (type(error), error.code) == (taskrpc.GoalAborted, taskrpc.Code.OUTCOME_UNKNOWN)
    assert error.not_executed is False
    assert ended == [GoalState.ABORTED]
    (line,) = caplog.messages
    assert re.fullmatch(r"goal .* of /fibonacci has not ended within 2 s, so it was aborted", line)


@pytest.mark.real_time  # in virtual time, no time passes while a thread works
async def test_a_thread_that_ignores_the_end_delays_it_only_by_the_grace(monkeypatch):
    monkeypatch.setattr(module_of_node, "GOAL_GRACE", 0.05)
    gate, refused = threading.Event(), []

    def execute(goal):
        gate.wait(60)
        try:
            goal.publish_feedback(feedback(1))
        except taskrpc.TaskRpcError as error:
            refused.append(error)
        return result(1)

    async with stopped_programs(execute, threaded=True) as (handle, spinning):
        error = await ending(handle)
        await asyncio.wait([spinning])
        gate.set()
        await until(lambda: refused)
    assert error.code is taskrpc.Code.OUTCOME_UNKNOWN


@pytest.mark.parametrize("answer", ["refuses", "hangs"])
async def test_a_program_that_does_not_cancel_a_goal_gets_the_grace_and_not_more(answer, caplog):
    async def cancel(goal):
        if answer == "hangs":
            await asyncio.sleep(100)
        return False

    states = []

    async def execute(goal):
        await asyncio.sleep(1.5)
        states.append(goal.state)
        await asyncio.sleep(100)

    async with stopped_programs(execute, cancel=cancel) as (handle, spinning):
        error = await ending(handle, 10)
        await asyncio.wait([spinning])
    assert error.code is taskrpc.Code.OUTCOME_UNKNOWN
    assert states == [GoalState.EXECUTING]
    del error
    gc.collect()  # asyncio logs what nobody has awaited
    assert len(caplog.messages) == 1


async def test_a_goal_that_ends_within_the_grace_has_its_result():
    async def execute(goal):
        await asyncio.sleep(1.0)
        return result(7)

    async with stopped_programs(execute) as (handle, _):
        assert await ending(handle) == [7]


# Settings


async def test_wrong_settings_are_refused_with_what_was_expected():
    Trigger = srvgen.load("std_srvs/srv/Trigger")
    async with taskrpc.Node("server", transport="memory") as node:
        create = node.create_action_server
        with pytest.raises(TypeError, match=r"expected an action type such as .*Trigger"):
            create(Trigger, "a", echo)
        with pytest.raises(TypeError, match="the callback of a: expected a function that takes"):
            create(Fibonacci, "a", lambda: None)
        with pytest.raises(TypeError, match="`goal=` of a: expected a function that takes a r"):
            create(Fibonacci, "a", echo, goal=True)
        with pytest.raises(TypeError, match="`cancel=` of a: expected a function that takes a g"):
            create(Fibonacci, "a", echo, cancel=lambda: True)
        for wrong in (0, "3"):
            refusal = f"of a: expected a whole number from 1 on, such as 10, got {wrong!r}"
            with pytest.raises(ValueError, match=f"concurrency {refusal}"):
                create(Fibonacci, "a", echo, concurrency=wrong)
            with pytest.raises(ValueError, match=f"feedback_depth {refusal}"):
                node.create_action_client(Fibonacci, "a", feedback_depth=wrong)
        for wrong in (-1, "3"):
            refusal = f"result_timeout: expected seconds from 0, got {wrong!r}"
            with pytest.raises(ValueError, match=refusal):
                create(Fibonacci, "a", echo, result_timeout=wrong)
        assert node.status().services == ()


async def test_a_second_server_of_an_action_is_refused_and_leaves_nothing():
    async with programs(echo) as (_, _, client):
        async with taskrpc.Node("other", transport="memory", listen="other") as other:
            with pytest.raises(taskrpc.NameInUse, match="/fibonacci/_action/send_goal"):
                other.create_action_server(Fibonacci, "fibonacci", echo)
            assert other.status().services == ()
        assert await ending(await client.send_goal(order(1))) == [1]


async def test_the_load_of_an_action_is_in_the_status_of_its_node():
    async with programs(Sleeper()) as (node, _, client):
        await client.send_goal(order(1))
        handle = await client.send_goal(order(1))
        await asyncio.sleep(0.5)
        (status,) = [each for each in node.status().services if each.name == "/fibonacci"]
        assert (status.running, status.waiting) == (1, 1)
        await handle.result()
