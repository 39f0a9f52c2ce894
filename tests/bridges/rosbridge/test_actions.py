"""Actions over rosbridge: goals that a client sends, and actions that a client offers."""

import asyncio

import pytest

import taskrpc
from taskrpc.bridges.rosbridge import actions
from tests.bridges.rosbridge.clients import connected
from tests.core.actions.helpers import (
    Fibonacci,
    Sleeper,
    echo,
    feedback,
    order,
    result,
    wait_for_cancel,
)

FIBONACCI = {"action": "fibonacci", "action_type": "example_interfaces/Fibonacci"}
OFFER = {"action": "fibonacci", "type": "example_interfaces/action/Fibonacci"}
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


async def send(client, number=1, name="g", **fields):
    await client.send("send_action_goal", id=name, args={"order": number}, **FIBONACCI, **fields)


async def ended(client, name="g"):
    found = await client.next(op="action_result", id=name)
    return found["status"], found["values"], found["result"]


# Goals that a client sends


async def test_a_client_gets_the_feedback_and_the_result_of_its_goal():
    async def count(goal):
        for number in range(3):
            goal.publish_feedback(feedback(number))
        return result(7)

    async with connected() as (node, client):
        node.create_action_server(Fibonacci, "fibonacci", count)
        await send(client, feedback=True)
        for number in range(3):
            assert await client.next() == {
                "op": "action_feedback",
                "action": "fibonacci",
                "id": "g",
                "values": {"sequence": [number]},
            }
        assert await client.next() == {
            "op": "action_result",
            "action": "fibonacci",
            "id": "g",
            "values": {"sequence": [7]},
            "status": SUCCEEDED,
            "result": True,
        }


async def test_without_the_wish_a_client_gets_no_feedback():
    async def one(goal):
        goal.publish_feedback(feedback(1))
        return result(goal.request.order)

    async with connected() as (node, client):
        node.create_action_server(Fibonacci, "fibonacci", one)
        await client.send("send_action_goal", args=[5], **FIBONACCI)
        assert (await client.next())["values"] == {"sequence": [5]}


async def test_a_client_cancels_its_goal():
    async with connected() as (node, client):
        node.create_action_server(Fibonacci, "fibonacci", wait_for_cancel)
        await send(client, 3)
        await asyncio.sleep(1)
        await client.send("cancel_action_goal", id="g", action="fibonacci")
        assert await ended(client) == (CANCELED, {"sequence": [3]}, True)


async def test_a_goal_that_is_cancelled_before_the_server_accepts_it_is_cancelled_then():
    async def late(request):
        await asyncio.sleep(2)
        return True

    async with connected() as (node, client):
        node.create_action_server(Fibonacci, "fibonacci", wait_for_cancel, goal=late)
        await send(client, 3)
        await client.send("cancel_action_goal", id="g", action="fibonacci")
        state, _, _ = await ended(client)
        assert state == CANCELED


async def test_a_client_learns_that_the_server_does_not_cancel():
    async with connected() as (node, client):
        node.create_action_server(Fibonacci, "fibonacci", Sleeper(), cancel=lambda goal: False)
        await client.send("set_level", level="warning")
        await send(client, 5)
        await asyncio.sleep(1)
        await client.send("cancel_action_goal", id="g", action="fibonacci")
        warning = await client.next(op="status")
        assert (warning["id"], warning["level"]) == ("g", "warning")
        assert warning["msg"] == "cancel_action_goal: the server does not cancel the goal"
        assert await ended(client) == (SUCCEEDED, {"sequence": [5]}, True)


@pytest.mark.parametrize(
    ("fields", "status", "problem"),
    [
        ({"args": {"order": 2}}, ABORTED, "GoalAborted: out of reach"),
        ({"args": {"order": 3}}, 0, "GoalRejected: too far"),
        ({"args": {"order": "x"}}, 0, "FieldError: order: expected int32, got 'x' (str)"),
        (
            {"action_type": "std_srvs/Empty"},
            0,
            "DefinitionError: package 'std_srvs' has no action 'Empty'",
        ),
        ({"action_type": "std_srvs/srv/Empty"}, 0, "TaskRpcError: std_srvs/srv/Empty: "),
        ({"action_type": "tf2_msgs/action/LookupTransform"}, 0, "TypeMismatch: "),
        ({"action": "/nothing"}, 0, "ServiceUnavailable: no server offers /nothing"),
        ({"action": "a b"}, 0, "InvalidName: "),
    ],
)
async def test_a_failed_goal_has_a_text_instead_of_a_result(fields, status, problem):
    def accept(request):
        if request.order == 3:
            raise taskrpc.HandlerError("INVALID_ARGUMENT", "too far")
        return True

    async def execute(goal):
        raise taskrpc.HandlerError("ABORTED", "out of reach")

    async with connected() as (node, client):
        node.create_action_server(Fibonacci, "fibonacci", execute, goal=accept)
        await client.send("send_action_goal", **{"id": "g", **FIBONACCI, **fields})
        state, values, is_result = await ended(client)
        assert (state, is_result) == (status, False)
        assert values.startswith(problem)


async def test_the_goals_of_one_client_are_limited_and_their_ids_differ(monkeypatch):
    monkeypatch.setattr(actions, "MAX_GOALS", 2)
    async with connected(2) as (node, client, other):
        node.create_action_server(Fibonacci, "fibonacci", Sleeper(), concurrency=9)
        await send(client, 5, "a")
        await send(client, 5, "a")
        assert "the goal with the id 'a' has not ended" in (await client.next())["msg"]
        await send(client, 5, "b")
        await send(client, 5, "c")
        assert await ended(client, "c") == (
            0,
            "ServerBusy: expected at most 2 goals at a time",
            False,
        )
        await send(other, 5, "a")
        assert (await ended(other, "a"))[0] == SUCCEEDED
        assert (await ended(client, "a"))[0] == SUCCEEDED
        await send(client, 1, "a")
        assert (await ended(client, "a"))[0] == SUCCEEDED


async def test_a_client_that_reads_slowly_gets_the_newest_feedback():
    async def count(goal):
        for number in range(100):
            goal.publish_feedback(feedback(number))
            await asyncio.sleep(0.01)
        return result()

    async with connected() as (node, client):
        node.create_action_server(Fibonacci, "fibonacci", count)
        client.behind = True
        await send(client, feedback=True)
        await asyncio.sleep(5)
        assert len(client.sent) == 1
        client.behind = False
        client.session.drained()
        numbers = [(await client.next())["values"]["sequence"][0] for _ in range(17)]
        assert numbers == [0, *range(84, 100)]
        assert (await ended(client))[0] == SUCCEEDED


async def test_goals_of_a_client_that_leaves_continue_and_nothing_is_left():
    sleeper = Sleeper()
    async with connected() as (node, client):
        server = node.create_action_server(Fibonacci, "fibonacci", sleeper, concurrency=9)
        for number in range(5):
            await send(client, 50, f"{number}", feedback=True)
        await asyncio.sleep(1)
        client.session.close()
        await asyncio.sleep(1)
        assert server.status().running == 5
        assert not client.session._bridge.actions._users
        assert not client.session._goals._goals
        assert not client.sent


async def test_when_the_gateway_ends_its_goals_get_a_result_first():
    async with connected() as (node, client):
        server = node.create_action_server(Fibonacci, "fibonacci", Sleeper())
        await send(client, 50)
        await asyncio.sleep(1)
        client.session.end()
        expected = "OutcomeUnknown: the gateway ends; the goal may continue"
        assert await ended(client) == (0, expected, False)
        await send(client, 50, "h")
        assert "the goal has not been sent" in (await ended(client, "h"))[1]
        assert server.status().running == 1


async def test_a_few_unused_clients_of_actions_are_kept(monkeypatch):
    monkeypatch.setattr(actions, "_KEPT_CLIENTS", 2)
    async with connected() as (node, client):
        for number in range(4):
            node.create_action_server(Fibonacci, f"a{number}", echo)
        for number in range(4):
            fields = {**FIBONACCI, "action": f"/a{number}"}
            await client.send("send_action_goal", id="g", args=[1], **fields)
            assert (await ended(client))[0] == SUCCEEDED
        kept = client.session._bridge.actions._clients
        assert [name for name, _ in kept] == ["/a2", "/a3"]


@pytest.mark.parametrize("role", [taskrpc.Role.OBSERVE, taskrpc.Role.SUBMIT])
async def test_a_client_has_the_role_of_the_gateways_account(role):
    account = taskrpc.Account("gateway", "s" * 20, role)
    accounts = taskrpc.Accounts([account])
    program = {"listen": "program", "accounts": accounts}
    gateway = {"peers": ["program"], "token": account.token}
    async with connected(program=program, gateway=gateway) as (node, client):
        executed = []
        node.create_action_server(
            Fibonacci, "fibonacci", lambda goal: executed.append(goal) or result(1)
        )
        await send(client)
        status, values, is_result = await ended(client)
        if role is taskrpc.Role.SUBMIT:
            assert (status, is_result, len(executed)) == (SUCCEEDED, True, 1)
            return
        assert (status, is_result, executed) == (0, False, [])
        assert values == (
            "PermissionDenied: /fibonacci/_action/send_goal needs the role submit; the account"
            " gateway has observe"
        )
        await client.send("cancel_action_goal", id="g", action="fibonacci")
        assert "no goal with the id 'g' waits" in (await client.next(op="status"))["msg"]


# Actions that a client offers


async def begun(node, client, number=3):
    """A goal of a program for the client's action, and the operation that the client got."""
    caller = node.create_action_client(Fibonacci, "/fibonacci")
    handle = await caller.send_goal(order(number))
    return handle, await client.next(op="send_action_goal")


async def test_a_client_executes_a_goal_of_a_program():
    async with connected() as (node, client):
        await client.send("advertise_action", **OFFER)
        handle, got = await begun(node, client)
        assert got["args"] == {"order": 3}
        assert (got["action"], got["action_type"], got["feedback"]) == (*OFFER.values(), True)
        known = {"id": got["id"], "action": "fibonacci"}
        await client.send("action_feedback", values={"sequence": [1]}, **known)
        await client.send("action_feedback", values={"sequence": "x"}, **known)
        assert "action_feedback: sequence: expected" in (await client.next())["msg"]
        ending = {"status": SUCCEEDED, "result": True, **known}
        await client.send("action_result", values={"sequence": [1, 2]}, **ending)
        assert await handle.result() == result(1, 2)
        assert [each async for each in handle.feedback] == [feedback(1)]
        await client.send("set_level", level="info")
        for op in ("action_result", "action_feedback"):
            await client.send(op, **ending)
            assert "is executed" in (await client.next(op="status"))["msg"]


async def test_a_program_cancels_a_goal_that_a_client_executes():
    async with connected() as (node, client):
        await client.send("advertise_action", **OFFER)
        handle, got = await begun(node, client)
        assert await handle.cancel()
        known = {"id": got["id"], "action": "fibonacci"}
        assert await client.next() == {"op": "cancel_action_goal", **known}
        values = {"sequence": [1]}
        await client.send("action_result", status=CANCELED, result=True, values=values, **known)
        with pytest.raises(taskrpc.GoalCanceled) as canceled:
            await handle.result()
        assert canceled.value.result == result(1)


@pytest.mark.parametrize(
    ("response", "problem"),
    [
        ({"result": False, "status": ABORTED, "values": "no battery"}, "no battery"),
        ({"result": False, "status": ABORTED}, "the goal failed"),
        ({"result": True, "status": ABORTED}, "was aborted"),
        ({"result": True, "status": CANCELED}, "was aborted"),
        ({"result": True, "values": 5}, "sent an invalid result: expected the fields of"),
    ],
)
async def test_the_program_gets_the_failure_of_the_client(response, problem):
    async with connected() as (node, client):
        await client.send("advertise_action", **OFFER)
        handle, got = await begun(node, client)
        await client.send("action_result", id=got["id"], action="fibonacci", **response)
        with pytest.raises(taskrpc.GoalAborted, match=problem):
            await handle.result()


@pytest.mark.parametrize("way", ["leave", "withdraw", "replace"])
async def test_goals_of_an_action_that_ends_are_unknown(way):
    async with connected() as (node, client):
        await client.send("advertise_action", **OFFER)
        handle, _ = await begun(node, client)
        if way == "leave":
            client.session.close()
        elif way == "withdraw":
            await client.send("unadvertise_action", action="/fibonacci")
        else:
            await client.send("advertise_action", **OFFER)
        with pytest.raises(taskrpc.OutcomeUnknown):
            await handle.result()


async def test_result_of_a_goal_of_the_replaced_action_ends_no_later_goal():
    async with connected() as (node, client):
        await client.send("advertise_action", **OFFER)
        handle, got = await begun(node, client)
        await client.send("advertise_action", **OFFER)  # the program of the client began again
        with pytest.raises(taskrpc.OutcomeUnknown):
            await handle.result()
        later, its = await begun(node, client)
        for name, value in ((got["id"], -1), (its["id"], 3)):
            ending = {"status": SUCCEEDED, "result": True, "values": {"sequence": [value]}}
            await client.send("action_result", id=name, action="fibonacci", **ending)
        assert await later.result() == result(3)


async def test_one_client_sends_a_goal_to_the_action_of_another():
    async with connected(2) as (_, one, other):
        await one.send("advertise_action", **OFFER)
        await send(other, 4)
        got = await one.next(op="send_action_goal")
        await one.send("action_result", id=got["id"], action="x", values={"sequence": [9]})
        assert await ended(other) == (SUCCEEDED, {"sequence": [9]}, True)


async def test_actions_of_one_client_are_limited(monkeypatch):
    monkeypatch.setattr("taskrpc.bridges.rosbridge.session.MAX_ACTIONS", 1)
    async with connected() as (_, client):
        await client.send("advertise_action", **OFFER)
        await client.send("advertise_action", **{**OFFER, "action": "/other"})
        assert "expected at most 1 actions of one client" in (await client.next())["msg"]
