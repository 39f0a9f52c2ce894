"""Services of ROS programs and for ROS programs, on a fake rclpy."""

from __future__ import annotations

import asyncio

import pytest

import srvgen
from taskrpc.core.transport.tunnel.handoff import Handoff
from taskrpc.errors import HandlerFailed, InvalidRequest
from taskrpc.middleware.ros.native_services import NativeClient, NativeServer, refusal
from tests.middleware.ros.fake_ros import Future, ros_service

Trigger = srvgen.load("std_srvs/srv/Trigger")
SetBool = srvgen.load("std_srvs/srv/SetBool")
TYPES = SetBool, ros_service("std_srvs/srv/SetBool")


@pytest.fixture
async def handoff():
    return Handoff(asyncio.get_running_loop())


@pytest.fixture
def node(ros):
    return ros.new_node("node")


def serve(ros, node, handoff, serving):
    return NativeServer(ros, node, "/lamp", TYPES, serving, handoff)


def request(ros, data=True):
    """Send a request as a ROS program does; return its future."""
    future = Future(lambda future: None)
    ros.services["/lamp"].request(TYPES[1].Request(data=data), future)
    return future


async def test_request_of_ros_gets_a_later_response(ros, node, handoff):
    got = []
    serve(ros, node, handoff, lambda *call: got.append(call))
    first, second = request(ros, True), request(ros, False)
    await asyncio.sleep(0)
    assert [each.data for each, _ in got] == [True, False]
    got[1][1].reply(SetBool.Response(success=True, message="second"))
    got[0][1].reply(SetBool.Response(message="first"))
    assert (second.result().success, second.result().message) == (True, "second")
    assert first.result().message == "first"


async def test_error_is_told_in_success_and_message(ros, node, handoff, caplog):
    serve(ros, node, handoff, lambda _, reply: reply.fail(HandlerFailed("NOT_FOUND", "no lamp")))
    future = request(ros)
    await asyncio.sleep(0)
    assert (future.result().success, future.result().message) == (False, "no lamp")
    assert "a call of a ROS program to /lamp failed: no lamp" in caplog.text


def test_response_without_success_and_message_cannot_tell_an_error():
    assert refusal(srvgen.load("std_srvs/srv/Empty").Response, "no") is None
    assert refusal(Trigger.Response, "x" * 900).message == "x" * 500


async def test_closed_server_drops_requests_and_responses(ros, node, handoff):
    got = []
    server = serve(ros, node, handoff, lambda *call: got.append(call))
    first, late = request(ros), None
    await asyncio.sleep(0)
    late = request(ros)
    server.close()
    server.close()
    got[0][1].reply(SetBool.Response())
    await asyncio.sleep(0)
    assert len(got) == 1
    assert first.result() is None
    assert late.result() is None


async def test_call_waits_for_the_server_and_returns_its_response(ros, node, handoff):
    client = NativeClient(node, "/lamp", TYPES, handoff)
    done = asyncio.get_running_loop().create_future()
    client.call(SetBool.Request(data=True), lambda *ended: done.set_result(ended))
    await asyncio.sleep(0.02)
    assert not done.done()
    serve(ros, node, handoff, lambda _, reply: reply.reply(SetBool.Response(message="on")))
    response, error = await done
    assert (response, error) == (SetBool.Response(message="on"), None)


async def test_cancelled_call_is_forgotten(ros, node, handoff):
    ways_back, ended = [], []
    serve(ros, node, handoff, lambda _, reply: ways_back.append(reply))
    client = NativeClient(node, "/lamp", TYPES, handoff)
    call = client.call(SetBool.Request(), lambda *result: ended.append(result))
    await asyncio.sleep(0)
    call.cancel()
    assert client.client.pending == []
    ways_back[0].reply(SetBool.Response())
    await asyncio.sleep(0)
    assert ended == []


async def test_call_that_waits_for_its_server_can_be_cancelled(ros, node, handoff):
    client = NativeClient(node, "/lamp", TYPES, handoff)
    ended = []
    client.call(SetBool.Request(), lambda *result: ended.append(result)).cancel()
    serve(ros, node, handoff, lambda _, reply: reply.reply(SetBool.Response()))
    await asyncio.sleep(1)
    assert ended == []


async def test_invalid_request_is_refused_before_it_is_sent(node, handoff):
    client = NativeClient(node, "/lamp", TYPES, handoff)
    with pytest.raises(InvalidRequest, match="data"):
        client.call(SetBool.Request(data="yes"), lambda *_: None)
