"""Nodes on the engine with a fake rclpy: taskrpc programs and ROS programs on one graph."""

from __future__ import annotations

import asyncio
import os
import threading

import pytest

import srvgen
import taskrpc
from taskrpc.errors import ServiceUnavailable, TaskRpcError, TypeMismatch
from taskrpc.middleware.ros import ros_engine
from taskrpc.middleware.ros.graph import ENCLAVE
from tests.middleware.ros.fake_ros import Future, ros_service

Trigger = srvgen.load("std_srvs/srv/Trigger")
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
String = srvgen.load("std_msgs/msg/String")
ROS_TRIGGER = ros_service("std_srvs/srv/Trigger")
GRAPH = 4 * ros_engine.LOOK


def node(name, number=0, **options):
    """Return a node; those with different numbers are different programs."""
    return taskrpc.Node(name, transport="ros", listen=f"program {number}", **options)


def hello(_, response):
    response.success, response.message = True, "hello"
    return response


def foreign_server(ros, callback=lambda request, _: ROS_TRIGGER.Response(message="from ROS")):
    """Add a ROS node that serves /greet."""
    made = ros.new_node("greeter")
    made.service_types["/greet"] = ["std_srvs/srv/Trigger"]
    made.hashes = {
        "rr/greetReply": Trigger.Response._HASH,
        "rq/greetRequest": Trigger.Request._HASH,
    }
    made.create_service(ROS_TRIGGER, "/greet", callback, qos_profile=None)
    return made


async def test_two_programs_call_each_other_over_hidden_topics(ros):
    async with node("server") as server, node("client", 1) as client:
        server.create_service(AddTwoInts, "/add", _add)
        adding = client.create_client(AddTwoInts, "/add")
        assert await adding.wait_for_service(10)
        assert (await adding.call(AddTwoInts.Request(a=1, b=2))).sum == 3


def _add(request, response):
    response.sum = request.a + request.b
    return response


async def test_nodes_of_other_programs_are_not_foreign_without_an_enclave_either(ros, monkeypatch):
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    async with node("server"), node("client", 1) as client:
        await asyncio.sleep(GRAPH)
        scripts = [entry.script for entry in await client.graph()]
    assert len(scripts) == 2
    assert not any("ROS 2 node" in script for script in scripts)


async def test_nodes_are_nodes_of_ros_with_the_enclave_of_the_program(ros):
    others = set(threading.enumerate())
    async with node("arm", namespace="/robot"):
        names = {(each.namespace, each.name): each.enclave for each in ros.nodes}
        assert names["/robot", "arm"].startswith(ENCLAVE)
    for thread in set(threading.enumerate()) - others:
        if thread.name.startswith("taskrpc "):  # only these threads destroy nodes
            await asyncio.to_thread(thread.join, 60)
            assert not thread.is_alive()
    assert ros.nodes == []


async def test_enclave_of_the_user_stays_with_the_security_of_ros(ros, monkeypatch):
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    async with node("arm"):
        assert {each.enclave for each in ros.nodes} == {"/"}


async def test_ros_program_calls_a_service(ros):
    async with node("server") as server:
        server.create_service(Trigger, "/hello", hello)
        future = Future(lambda future: None)
        ros.services["/hello"].request(ROS_TRIGGER.Request(), future)
        await asyncio.sleep(0.01)
        assert future.result().message == "hello"


@pytest.mark.parametrize(
    ("create", "problem"),
    [
        (
            lambda made, cls: made.create_publisher(cls, "/x"),
            "ROS programs do not see /x: ROS has not",
        ),
        (
            lambda made, cls: made.create_subscription(cls, "/x", print),
            "no messages of ROS programs arrive on /x: ROS has not",
        ),
    ],
)
async def test_topic_whose_package_is_not_built_is_reported(ros, caplog, create, problem):
    door = srvgen.define("door_msgs/msg/Door", "int32 angle\n")
    async with node("arm") as made:
        create(made, door)
        assert problem in caplog.text


async def test_package_that_is_not_built_is_reported_once(ros, caplog):
    async with node("server") as server:
        server.create_service(AddTwoInts, "/add", _add)
        server.create_service(AddTwoInts, "/sum", _add)
        assert caplog.text.count("ROS has not built the package example_interfaces") == 1
        assert ros.services == {}


async def test_service_of_ros_is_called(ros):
    foreign_server(ros)
    async with node("client") as client:
        greeting = client.create_client(Trigger, "/greet")
        assert (await greeting.call(Trigger.Request())).message == "from ROS"
        entry = next(each for each in await client.graph() if each.nodes == ("/greeter",))
        assert entry.services[0].type_hash == Trigger._HASH


async def test_server_that_appears_and_leaves_is_noticed(ros):
    async with node("client") as client:
        greeting = client.create_client(Trigger, "/greet")
        with pytest.raises(ServiceUnavailable):
            await greeting.call(Trigger.Request())
        server = foreign_server(ros)
        assert await greeting.wait_for_service(GRAPH)
        server.destroy_node()
        await asyncio.sleep(GRAPH)
        assert not greeting.service_is_ready()


async def test_call_with_another_definition_gives_both_hashes(ros):
    foreign_server(ros)
    other = srvgen.define("std_srvs/srv/Trigger", "int32 x\n---\nbool success\n")
    async with node("client") as client:
        with pytest.raises(TypeMismatch) as caught:
            await client.create_client(other, "/greet").call(other.Request())
        assert other._HASH[:15] in str(caught.value)
        assert Trigger._HASH[:15] in str(caught.value)


async def test_topic_reaches_another_program(ros):
    async with node("talker") as talker, node("listener", 1) as listener:
        got = asyncio.Queue()
        listener.create_subscription(String, "/chat", got.put_nowait)
        publisher = talker.create_publisher(String, "/chat")
        publisher.publish(String(data="over ROS"))
        assert (await got.get()).data == "over ROS"


async def test_shut_down_context_interrupts_the_engine(ros, caplog, monkeypatch):
    foreign_server(ros)
    async with node("client") as client:
        ours = next(each for each in ros.nodes if each.name == "client")
        monkeypatch.setattr(type(ours), "get_topic_names_and_types", lambda _: 1 / 0)
        await asyncio.sleep(GRAPH)
        assert "cannot read ROS's graph" in caplog.text
        engine = client._transport.network._engine
        engine._context.try_shutdown()
        await asyncio.sleep(GRAPH)
        assert "ROS 2 is interrupted: rclpy's context was shut down" in caplog.text


async def test_error_of_rclpy_at_the_start_is_one_message(ros, monkeypatch):
    monkeypatch.setattr(ros.context.Context, "init", lambda *_, **__: 1 / 0)
    with pytest.raises(TaskRpcError, match="ROS 2 cannot start here: division by zero"):
        async with node("x"):
            pass


async def test_domain_is_passed_to_ros(ros, monkeypatch):
    monkeypatch.setitem(os.environ, "ROS_DOMAIN_ID", "7")
    async with node("x") as made:
        assert made._transport.network._engine._context.domain_id == 7
