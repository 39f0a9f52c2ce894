"""One client's operations: statuses, calls, order, and the end of the session."""

import asyncio
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import srvgen
from taskrpc.bridges.rosbridge import session
from taskrpc.testing import VirtualTimeLoop
from tests.bridges.rosbridge.clients import connected
from tests.properties import examples

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
TRIGGER = srvgen.load("std_srvs/srv/Trigger")

OPS = (
    "advertise unadvertise publish subscribe unsubscribe call_service advertise_service"
    " unadvertise_service service_response set_level fragment send_action_goal"
    " cancel_action_goal advertise_action unadvertise_action action_feedback action_result fly"
).split()
NAMES = ["/chatter", "/add", "/mine", "a b", "~/x", "//", "", "/rosapi/topics", "/rosapi/get_param"]
TYPES = ["std_msgs/String", "std_srvs/Trigger", "example_interfaces/AddTwoInts", "no/Type", "../x"]
TYPES += ["example_interfaces/Fibonacci"]
VALUES = [None, 1, 2**70, "x" * 600, [1], {}, {"data": "x"}, {"a": 1}, {"name": "a:b"}]
NUMBERS = [None, 0, 1, 2, -1, 1.5, float("nan"), 2**70]
OPERATIONS = st.fixed_dictionaries(
    {
        "op": st.sampled_from(OPS),
        "topic": st.sampled_from(NAMES),
        "service": st.sampled_from(NAMES),
        "type": st.sampled_from(TYPES),
        "level": st.sampled_from(["error", "warning", "info", 5]),
        "action": st.sampled_from(NAMES),
        "action_type": st.sampled_from(TYPES),
    },
    optional={
        **dict.fromkeys(["id", "msg", "args", "values", "data"], st.sampled_from(VALUES)),
        **dict.fromkeys(["timeout", "throttle_rate", "num", "total"], st.sampled_from(NUMBERS)),
        **dict.fromkeys(["queue_length", "queue_size"], st.sampled_from(NUMBERS)),
        "latch": st.booleans(),
    },
)


def add(request, response):
    response.sum = request.a + request.b
    return response


async def never(request, response):
    await asyncio.Event().wait()


async def test_call_returns_the_response_with_id_and_name_as_given():
    async with connected() as (node, client):
        node.create_service(ADD, "/add", add)
        assert await client.call("add", {"a": 1, "b": 2}) == {
            "op": "service_response",
            "id": "call",
            "service": "add",
            "values": {"sum": 3},
            "result": True,
        }
        await client.send("call_service", service="/add", args=[5])
        assert await client.next() == {
            "op": "service_response",
            "service": "/add",
            "values": {"sum": 5},
            "result": True,
        }


async def test_failed_call_has_a_text_instead_of_values():
    def broken(request, response):
        raise RuntimeError("secret")

    async with connected() as (node, client):
        node.create_service(TRIGGER, "/broken", broken)
        node.create_service(ADD, "/add", add)
        for service, args, problem in (
            ("/nothing", None, "ServiceUnavailable: no server offers /nothing"),
            ("/add", {"a": "x"}, "FieldError: a: expected int64, got 'x' (str)"),
            ("/a b", None, "InvalidName: "),
            ("/broken", None, "HandlerFailed: the handler failed"),
        ):
            response = await client.call(service, args)
            assert response["result"] is False
            assert response["values"].startswith(problem)


async def test_call_ends_at_its_timeout_and_the_handler_is_cancelled():
    cancelled = asyncio.Event()

    async def slow(request, response):
        try:
            await never(request, response)
        finally:
            cancelled.set()

    async with connected() as (node, client):
        node.create_service(TRIGGER, "/slow", slow)
        began = asyncio.get_running_loop().time()
        response = await client.call("/slow", timeout=0.5)
        assert response["values"].startswith("DeadlineExceeded: ")
        assert asyncio.get_running_loop().time() - began == pytest.approx(0.5, abs=0.1)
        await asyncio.wait_for(cancelled.wait(), 5)


@pytest.mark.parametrize(("timeout", "expected"), [(None, 10.0), (0, 100.0), (-1, 100.0)])
async def test_call_without_a_timeout_has_the_default_and_zero_means_no_deadline(timeout, expected):
    async def slow(request, response):
        await asyncio.sleep(100)
        return response

    async with connected() as (node, client):
        node.create_service(TRIGGER, "/slow", slow)
        began = asyncio.get_running_loop().time()
        await client.call("/slow", timeout=timeout)
        assert asyncio.get_running_loop().time() - began == pytest.approx(expected, abs=0.2)


async def test_slow_call_holds_up_no_other_operation():
    async with connected() as (node, client):
        node.create_service(TRIGGER, "/slow", never)
        node.create_service(ADD, "/add", add)
        await client.send("call_service", id="slow", service="/slow")
        assert (await client.call("/add", [1, 1]))["id"] == "call"


async def test_one_client_has_a_limited_number_of_calls_and_others_are_served(monkeypatch):
    monkeypatch.setattr(session, "MAX_CALLS", 2)
    async with connected(2) as (node, greedy, other):
        node.create_service(TRIGGER, "/slow", never)
        node.create_service(ADD, "/add", add)
        for _ in range(3):
            await greedy.send("call_service", service="/slow")
        response = await greedy.next()
        assert response["values"] == "ServerBusy: expected at most 2 calls at a time"
        assert (await other.call("/add", [1, 1]))["result"] is True


async def test_few_calls_of_rosapi_run_in_one_turn_of_the_event_loop(monkeypatch):
    turns = []

    async def note_the_turn(verb, args):
        turns.append(turn)
        return {}

    async with connected() as (_, client):
        monkeypatch.setattr(client.session._bridge.rosapi, "call", note_the_turn)
        for _ in range(40):
            await client.send("call_service", service="/rosapi/interfaces")
        for turn in range(100):  # noqa: B007 (note_the_turn reads it)
            await asyncio.sleep(0)
    assert len(turns) == 40
    assert max(map(turns.count, turns)) <= session.MAX_ROSAPI_CALLS


async def test_closed_session_cancels_its_calls():
    cancelled = asyncio.Event()

    async def slow(request, response):
        try:
            await never(request, response)
        finally:
            cancelled.set()

    async with connected() as (node, client):
        node.create_service(TRIGGER, "/slow", slow)
        await client.send("call_service", service="/slow")
        await asyncio.sleep(1)
        client.session.close()
        await asyncio.wait_for(cancelled.wait(), 5)
        assert client.sent == []


async def test_service_with_a_new_definition_is_called_with_it():
    async with connected() as (node, client):
        first = node.create_service(ADD, "/x", add)
        assert (await client.call("/x", [1, 1]))["result"] is True
        first.destroy()
        node.create_service(TRIGGER, "/x", lambda request, response: response)
        assert (await client.call("/x"))["values"] == {"success": False, "message": ""}


async def test_call_of_a_known_service_is_sent_at_once_and_starts_no_task():
    async with connected() as (node, client):
        node.create_service(ADD, "/add", add)
        await client.call("/add", [1, 1])
        tasks = asyncio.all_tasks()
        await client.send("call_service", id="call", service="/add", args=[1, 2])
        assert asyncio.all_tasks() == tasks
        assert (await client.next())["values"] == {"sum": 3}


@pytest.mark.parametrize("step", ["begin", "call"])
async def test_unexpected_error_of_a_call_is_logged_and_the_call_fails(monkeypatch, caplog, step):
    async def call(*args):
        raise RuntimeError("secret")

    def begin(*args):
        raise RuntimeError("secret")

    async with connected() as (_, client):
        monkeypatch.setattr(
            client.session._bridge.clients, step, {"begin": begin, "call": call}[step]
        )
        assert (await client.call("/add"))["result"] is False
    assert "RuntimeError: secret" in caplog.text


async def test_wrong_operation_gets_an_error_status_and_the_session_goes_on():
    async with connected() as (node, client):
        node.create_service(ADD, "/add", add)
        for text in ("{", "[]", '{"op": "fly", "id": 1}', '{"op": "publish", "topic": "/x"}'):
            await client.session.receive(text)
            found = await client.next()
            assert (found["op"], found["level"]) == ("status", "error")
        assert (await client.call("/add", [1, 1]))["result"] is True


async def test_client_gets_no_details_of_an_unexpected_error_and_the_log_gets_them(
    monkeypatch, caplog
):
    async def broken(node):
        raise RuntimeError("secret")

    monkeypatch.setattr(session, "graph_of", broken)
    async with connected() as (_, client):
        await client.send("subscribe", topic="/x", type="std_msgs/String", id="s")
        found = await client.next()
        assert found["msg"] == "subscribe: the gateway failed to do it; see its log"
        assert found["id"] == "s"
    assert "RuntimeError: secret" in caplog.text


async def test_level_decides_which_statuses_are_sent():
    async with connected() as (_, client):
        await client.send("service_response", id="x")
        await client.session.receive("{")
        await client.send("set_level", level="info")
        await client.send("service_response", id="x")
        await client.send("set_level", level="none")
        await client.session.receive("{")
        assert [each["level"] for each in client.sent] == ["error", "info"]


async def test_operation_in_fragments_is_carried_out():
    async with connected() as (node, client):
        node.create_service(ADD, "/add", add)
        text = json.dumps({"op": "call_service", "service": "/add", "args": {"a": 1, "b": 2}})
        for num, part in enumerate((text[:20], text[20:])):
            await client.send("fragment", id="f", data=part, num=num, total=2)
        assert (await client.next())["values"] == {"sum": 3}
        inner = json.dumps({"op": "fragment", "id": "g", "data": "", "num": 0, "total": 1})
        await client.send("fragment", id="f", data=inner, num=0, total=1)
        assert "got a fragment" in (await client.next())["msg"]


async def test_long_response_is_sent_in_fragments():
    def tell(request, response):
        response.message = "x" * 500
        return response

    async with connected() as (node, client):
        node.create_service(TRIGGER, "/tell", tell)
        await client.send("call_service", service="/tell", fragment_size=200)
        await client.next(op="fragment", num=0)
        await client.next(op="fragment", num=2, total=3)


SUBSCRIBE = {"op": "subscribe", "topic": "/x", "type": "std_msgs/String", "id": "a"}
ADVERTISE = {"op": "advertise", "topic": "/x", "type": "std_msgs/String", "id": "a"}


@pytest.mark.parametrize(
    ("operations", "problem"),
    [
        ([{"op": "unsubscribe", "topic": "/x"}], "this client has no subscription of /x"),
        (
            [SUBSCRIBE, {"op": "unsubscribe", "topic": "/x", "id": "b"}],
            "unsubscribe: no subscription of /x has the id 'b'",
        ),
        ([{"op": "unadvertise", "topic": "/x"}], "this client does not advertise /x"),
        (
            [ADVERTISE, {"op": "unadvertise", "topic": "/x", "id": "b"}],
            "unadvertise: the client has not advertised /x with the id 'b'",
        ),
        (
            [ADVERTISE, SUBSCRIBE | {"type": "std_msgs/Bool"}],
            "subscribe: the topic /x has the type std_msgs/msg/String, not std_msgs/Bool",
        ),
        (
            [SUBSCRIBE, SUBSCRIBE | {"type": "std_msgs/Bool", "id": "b"}],
            "subscribe: the topic /x has the type std_msgs/msg/String, not std_msgs/Bool",
        ),
        ([SUBSCRIBE | {"compression": "png"}], "no compression png; messages are sent as JSON"),
        (
            [{"op": "advertise_action", "action": "/dock", "type": "std_msgs/String"}],
            "advertise_action: package 'std_msgs' has no action 'String'",
        ),
        (
            [{"op": "unadvertise_action", "action": "/dock"}],
            "unadvertise_action: this client does not offer /dock",
        ),
        (
            [{"op": "cancel_action_goal", "action": "/dock", "id": "g"}],
            "cancel_action_goal: no goal with the id 'g' waits for its end",
        ),
        (
            [SUBSCRIBE | {"type": "actionlib_msgs/GoalStatusArray"}],
            "it is of ROS 1; expected ROSLI",
        ),
        ([{"op": "auth", "mac": "x"}], "send the HTTP header Authorization"),
    ],
)
async def test_mistake_gets_one_error_status_with_the_reason(operations, problem):
    async with connected() as (_, client):
        for operation in operations:
            await client.session.receive(json.dumps(operation))
        [status] = client.sent
        assert (status["op"], status["level"]) == ("status", "error")
        assert problem in status["msg"]
        assert status.get("id") == operations[-1].get("id")


async def test_number_of_ids_that_advertise_one_topic_is_limited():
    async with connected() as (_, client):
        for number in range(257):
            await client.session.receive(json.dumps(ADVERTISE | {"id": number}))
        assert "at most 256 ids" in client.sent[0]["msg"]


@given(st.lists(OPERATIONS, max_size=30))
@settings(max_examples=examples(25))
def test_any_operations_leave_the_session_working(operations):
    async def run():
        async with connected() as (node, client):
            node.create_service(ADD, "/add_two_ints", add)
            for operation in operations:
                await client.session.receive(json.dumps(operation))
            told = [each["msg"] for each in client.sent if each["op"] == "status"]
            assert not [each for each in told if each.endswith("failed to do it; see its log")]
            assert (await client.call("/add_two_ints", [1, 1]))["op"] == "service_response"

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(run())


async def test_ending_gateway_responds_to_each_call_in_flight_once_and_cancels_it():
    cancelled = asyncio.Event()

    async def slow(request, response):
        try:
            await never(request, response)
        finally:
            cancelled.set()

    async with connected() as (node, client):
        node.create_service(TRIGGER, "/slow", slow)
        await client.call("/slow", timeout=0.1)  # the gateway knows the definition now
        cancelled.clear()
        for name in ("known", "rosapi"):
            service = "/slow" if name == "known" else "/rosapi/interfaces"
            await client.send("call_service", id=name, service=service)
        client.session.end()
        await client.send("call_service", id="late", service="/slow")
        await asyncio.wait_for(cancelled.wait(), 5)
        await asyncio.sleep(1)
        client.session.close()
        assert [(each["id"], each["result"], each["values"]) for each in client.sent] == [
            ("known", False, "OutcomeUnknown: the gateway ends; the call may have run"),
            ("rosapi", False, "OutcomeUnknown: the gateway ends; the call may have run"),
            ("late", False, "ServiceUnavailable: the gateway ends; the call has not run"),
        ]
