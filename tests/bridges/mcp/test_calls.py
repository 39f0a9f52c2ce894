"""Calls of tools by the official client: services, errors, repeated calls, a policy, goals."""

import asyncio
import json

import pytest
from mcp import Client

import srvgen
import taskrpc
from taskrpc.bridges.door import Decision, Outcome
from taskrpc.bridges.mcp.calls import ToolCalls
from taskrpc.bridges.mcp.permissions import Permissions
from taskrpc.bridges.mcp.server import AgentServer
from tests.bridges.mcp.agents import MODES, connected, failed
from tests.bridges.mcp.doors import TableDoor

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
TRIGGER = srvgen.load("std_srvs/srv/Trigger")
FIBONACCI = srvgen.load("example_interfaces/action/Fibonacci")


def add(request, response):
    response.sum = request.a + request.b
    return response


# Services


async def test_service_that_has_another_definition_now_is_called_after_the_tools_are_listed_again():
    calls = []
    async with connected() as (node, client):
        first = node.create_service(ADD, "it", add)
        assert (await client.call_tool("it", {"a": 1})).structured_content == {"sum": 1}
        first.destroy()
        await asyncio.sleep(1)
        node.create_service(TRIGGER, "it", lambda _, response: calls.append(1) or response)
        found = failed(await client.call_tool("it", {}))
        assert (found["error"], found["executed"], calls) == ("TypeMismatch", "no", [])
        await client.list_tools()
        result = await client.call_tool("it", {})
        assert result.structured_content == {"success": False, "message": ""}


@pytest.mark.parametrize(
    ("tool", "arguments", "error", "text"),
    [
        ("add", {"a": "2"}, "InvalidRequest", 'a: expected int64, got "2"'),
        ("add", {"c": 2}, "InvalidRequest", "unknown field 'c'"),
        ("ad", {}, "UnknownTool", "there is no tool 'ad'; did you mean add?"),
        ("add", {"_request_id": "x"}, "InvalidRequest", "does not run a repeated request once"),
        ("fails", {}, "HandlerFailed", "no battery"),
    ],
)
async def test_failed_call_says_what_is_wrong(tool, arguments, error, text):
    def fails(request, response):
        raise taskrpc.HandlerError("FAILED_PRECONDITION", "no battery")

    async with connected() as (node, client):
        node.create_service(ADD, "add", add)
        node.create_service(TRIGGER, "fails", fails)
        found = failed(await client.call_tool(tool, arguments))
        assert found["error"] == error
        assert text in found["message"]


async def test_dry_run_calls_nothing():
    calls = []
    async with connected() as (node, client):
        node.create_service(ADD, "add", lambda request, response: calls.append(1) or response)
        found = failed(await client.call_tool("add", {"a": 2, "_dry_run": True}))
        assert (found["error"], found["request"]) == ("DryRun", {"a": 2, "b": 0})
        assert calls == []


async def test_dry_run_of_a_task_has_the_estimate_of_the_task_server():
    robot_task = srvgen.load("my_robot_interfaces/srv/RobotTask")
    estimate_task = srvgen.load("taskrpc_interfaces/srv/EstimateTask")

    def estimate(request, response):
        response.success = True
        response.estimated_time = request.priority + 0.5
        return response

    async with connected() as (node, client):
        node.create_service(robot_task, "robot_task", lambda request, response: 1 / 0)
        node.create_service(estimate_task, "robot_task/estimate", estimate)
        node.create_service(robot_task, "other", lambda request, response: 1 / 0)
        arguments = {"task_type": "move", "target": "dock", "priority": 3, "_dry_run": True}
        without = failed(await client.call_tool("other", arguments))
        assert (without["error"], without.get("estimate")) == ("DryRun", None)
        found = failed(await client.call_tool("robot_task", arguments))
        assert found["error"] == "DryRun"
        assert found["estimate"] == {"success": True, "message": "", "estimated_time": 3.5}


async def test_request_id_of_the_session_runs_once_and_can_be_repeated_by_the_agent():
    calls = []

    async def progress(*_):
        pass

    def count(request, response):
        calls.append(1)
        response.message = str(len(calls))
        return response

    async with taskrpc.Node("program", transport="memory") as node:
        node.create_service(TRIGGER, "count", count, exactly_once=taskrpc.MemoryCompletions())
        tools = ToolCalls(node, Permissions())

        async def called(request_id, **given):
            return (await tools.call("count", given, request_id, progress)).json["message"]

        assert [await called("s-1"), await called("s-1"), await called("s-2")] == ["1", "1", "2"]
        assert await called("s-3", _request_id="s-1") == "1"
        assert [await called(""), await called("")] == ["3", "4"]


@MODES
async def test_repeated_call_of_an_exactly_once_service_runs_once(mode):
    store, calls = taskrpc.MemoryCompletions(), []

    def count(request, response):
        calls.append(1)
        response.success = True
        response.message = str(len(calls))
        return response

    async with connected(mode=mode) as (node, client):
        node.create_service(TRIGGER, "count", count, exactly_once=store)
        arguments = {"_request_id": "monday-1"}
        first = await client.call_tool("count", arguments)
        again = await client.call_tool("count", arguments)
        other = await client.call_tool("count", {})
        assert first.structured_content == again.structured_content
        assert [first.structured_content["message"], other.structured_content["message"]] == [
            "1",
            "2",
        ]
        (tool,) = (await client.list_tools()).tools
        assert "_request_id" in tool.input_schema["properties"]


async def test_cancelled_call_is_cancelled_at_the_server():
    began, ended = asyncio.Event(), asyncio.Event()

    async def slow(request, response):
        began.set()
        try:
            await asyncio.sleep(1000)
        finally:
            ended.set()

    async with connected(mode="legacy") as (node, client):
        node.create_service(TRIGGER, "slow", slow)
        call = asyncio.ensure_future(client.call_tool("slow", {}))
        await began.wait()
        call.cancel()
        await asyncio.wait_for(ended.wait(), 10)


# A policy


async def test_agent_sees_and_calls_only_what_the_policy_permits():
    door = TableDoor(add=Decision(Outcome.ALLOWED))
    async with connected(door, "agents") as (node, client):
        node.create_service(ADD, "add", add)
        node.create_service(ADD, "secret", add)
        assert [each.name for each in (await client.list_tools()).tools] == ["add"]
        assert (await client.call_tool("add", {"a": 1})).structured_content == {"sum": 1}
        assert failed(await client.call_tool("secret", {}))["error"] == "UnknownTool"
        assert door.asked == [("agents", "call", "/add", ADD.Request(a=1))]


async def test_refused_call_is_not_executed_and_names_the_rule():
    calls = []
    door = TableDoor(add=Decision(Outcome.REFUSED, 5, "a: expected 1 to 3, got 9"))
    async with connected(door, "agents") as (node, client):
        node.create_service(ADD, "add", lambda request, response: calls.append(1) or response)
        found = failed(await client.call_tool("add", {"a": 9}))
        assert (found["error"], found["executed"]) == ("Refused", "no")
        assert found["message"] == "a: expected 1 to 3, got 9 (line 5 of the policy)"
        assert calls == []


# Actions


async def fibonacci(goal):
    sequence = [0, 1]
    for _ in range(goal.request.order - 1):
        await asyncio.sleep(1)
        if goal.is_cancel_requested:
            return goal.canceled(FIBONACCI.Result(sequence=sequence))
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(FIBONACCI.Feedback(sequence=sequence))
    return FIBONACCI.Result(sequence=sequence)


@MODES
async def test_action_is_a_tool_with_progress(mode):
    steps = []

    async def progress(done, total, text):
        steps.append((done, json.loads(text)["sequence"][-1]))

    async with connected(mode=mode) as (node, client):
        node.create_action_server(FIBONACCI, "fibonacci", fibonacci)
        (tool,) = (await client.list_tools()).tools
        assert (tool.name, tool.title) == ("fibonacci--goal", "/fibonacci")
        arguments = {"order": 4}
        result = await client.call_tool(tool.name, arguments, progress_callback=progress)
        assert result.structured_content == {"sequence": [0, 1, 1, 2, 3]}
        assert steps == [(1.0, 1), (2.0, 2), (3.0, 3)]


async def test_progress_that_does_not_grow_is_left_out():
    execute_task = srvgen.load("my_robot_interfaces/action/ExecuteTask")
    steps = []

    async def execute(goal):
        for done in (0.0, 0.0, 0.5, 0.25, 1.0):
            goal.publish_feedback(execute_task.Feedback(progress=done))
            await asyncio.sleep(1)
        return execute_task.Result(success=True)

    async def progress(done, total, text):
        steps.append((done, total))

    async with connected() as (node, client):
        node.create_action_server(execute_task, "execute", execute)
        await client.call_tool("execute--goal", {}, progress_callback=progress)
        assert steps == [(0.0, 1.0), (0.5, 1.0), (1.0, 1.0)]


@pytest.mark.parametrize("end", ["cancel", "leave"])
async def test_goal_is_cancelled_when_its_call_is_cancelled_or_the_client_leaves(end):
    began, cancelled = asyncio.Event(), asyncio.Event()

    async def execute(goal):
        goal.publish_feedback(FIBONACCI.Feedback(sequence=[0]))
        await goal.wait_for_cancel()
        cancelled.set()
        return goal.canceled(FIBONACCI.Result(sequence=[0]))

    async def progress(done, total, text):
        began.set()

    async with taskrpc.Node("program", transport="memory") as node:
        node.create_action_server(FIBONACCI, "fibonacci", execute)
        agent = AgentServer(node)
        async with Client(agent.server, mode="legacy") as client:
            goal = client.call_tool("fibonacci--goal", {"order": 9}, progress_callback=progress)
            call = asyncio.ensure_future(goal)
            await began.wait()
            if end == "cancel":
                call.cancel()
                await asyncio.wait_for(cancelled.wait(), 10)
        await asyncio.wait_for(cancelled.wait(), 10)
        await asyncio.gather(call, return_exceptions=True)


async def test_aborted_goal_is_an_error_with_its_result():
    async def execute(goal):
        return goal.abort(FIBONACCI.Result(sequence=[7]))

    async with connected() as (node, client):
        node.create_action_server(FIBONACCI, "fibonacci", execute)
        found = failed(await client.call_tool("fibonacci--goal", {"order": 2}))
        assert (found["error"], found["result"]) == ("GoalAborted", {"sequence": [7]})
