"""The gateway between a robot (the memory engine with a foreign program) and a lab."""

from __future__ import annotations

import asyncio
import contextlib
from types import SimpleNamespace

import pytest

import srvgen
import taskrpc
from taskrpc.bridges.gateway import AccountLimits, Allowed, Gateway
from taskrpc.bridges.gateway.gateway import LOOK
from taskrpc.core.transport import shared_endpoint
from taskrpc.core.transport.shared_endpoint import Registration
from taskrpc.errors import (
    DeadlineExceeded,
    OutcomeUnknown,
    ServerBusy,
    ServiceUnavailable,
    TypeMismatch,
)

Trigger = srvgen.load("std_srvs/srv/Trigger")
SetBool = srvgen.load("std_srvs/srv/SetBool")
String = srvgen.load("std_msgs/msg/String")


@pytest.fixture
async def lab(monkeypatch):
    """A robot's node, a gateway of it, and a laptop."""
    memory = Registration("taskrpc.testing.memory_engine:open_network")
    monkeypatch.setitem(shared_endpoint.TRANSPORTS, "robot", memory)
    async with contextlib.AsyncExitStack() as stack:

        async def node(name, transport):
            made = taskrpc.Node(name, transport=transport, listen=name)
            return await stack.enter_async_context(made)

        robot = await node("robot", "robot")
        laptop = await node("laptop", "memory")
        sides = await node("inner", "robot"), await node("outer", "memory")
        made = Gateway(
            *sides,
            services=Allowed(["/arm/*"]),
            topics=Allowed(["/arm/status"]),
            limits=AccountLimits(rate=5, in_flight=3),
            timeout=2.0,
        )
        following = asyncio.create_task(made.follow())
        yield SimpleNamespace(robot=robot, laptop=laptop, gateway=made)
        following.cancel()
        made.close()


def hello(_, response):
    response.message = "hello"
    return response


async def test_service_appears_and_vanishes_with_that_of_the_robot(lab):
    service = lab.robot.create_service(Trigger, "/arm/open", hello)
    client = lab.laptop.create_client(Trigger, "/arm/open")
    assert await client.wait_for_service(3 * LOOK)
    assert (await client.call(Trigger.Request())).message == "hello"
    service.destroy()
    await asyncio.sleep(3 * LOOK)
    assert not client.service_is_ready()


async def test_laptop_needs_no_definition(lab):
    door = srvgen.define("door_msgs/srv/Open", "int32 angle  # degrees\n---\nbool done\n")
    lab.robot.create_service(door, "/arm/door", lambda request, _: door.Response(done=True))
    await asyncio.sleep(3 * LOOK)
    assert await lab.laptop.definition("/arm/door") == ("door_msgs/srv/Open", door._DEFINITION)


async def test_service_with_a_new_type_replaces_the_old_one(lab):
    service = lab.robot.create_service(Trigger, "/arm/open", hello)
    await asyncio.sleep(3 * LOOK)
    service.destroy()
    lab.robot.create_service(SetBool, "/arm/open", hello)
    await asyncio.sleep(3 * LOOK)
    client = lab.laptop.create_client(SetBool, "/arm/open")
    assert (await client.call(SetBool.Request())).message == "hello"


async def test_other_names_are_not_offered(lab):
    lab.robot.create_service(Trigger, "/leg/move", hello)
    await asyncio.sleep(3 * LOOK)
    with pytest.raises(ServiceUnavailable):
        await lab.laptop.create_client(Trigger, "/leg/move").call(Trigger.Request())
    assert lab.gateway.names == []


async def test_calls_over_the_rate_are_refused_with_the_time_to_wait(lab):
    lab.robot.create_service(Trigger, "/arm/open", hello)
    await asyncio.sleep(3 * LOOK)
    client = lab.laptop.create_client(Trigger, "/arm/open")
    for _ in range(5):
        await client.call(Trigger.Request())
    with pytest.raises(ServerBusy, match="at most 5 calls per second of one account") as caught:
        await client.call(Trigger.Request())
    await asyncio.sleep(caught.value.retry_after)
    assert await client.call(Trigger.Request())


async def test_calls_over_the_limit_of_open_calls_are_refused(lab):
    calls = []

    async def slow(_, response):
        calls.append(response)
        await asyncio.sleep(1)
        return response

    lab.robot.create_service(Trigger, "/arm/open", slow, concurrency=9)
    await asyncio.sleep(3 * LOOK)
    client = lab.laptop.create_client(Trigger, "/arm/open")
    ended = await asyncio.gather(
        *(client.call(Trigger.Request()) for _ in range(5)), return_exceptions=True
    )
    assert [type(each) for each in ended] == 3 * [Trigger.Response] + 2 * [ServerBusy]
    assert len(calls) == 3


async def test_call_that_its_caller_has_left_counts_until_the_timeout_of_the_gateway(lab):
    calls = []

    async def hang(_, response):
        calls.append(response)
        await asyncio.sleep(60)

    lab.robot.create_service(Trigger, "/arm/open", hang, concurrency=9)
    await asyncio.sleep(3 * LOOK)
    client = lab.laptop.create_client(Trigger, "/arm/open", timeout=0.1)
    first = [client.call(Trigger.Request()) for _ in range(3)]
    ended = await asyncio.gather(*first, return_exceptions=True)
    assert [type(each) for each in ended] == 3 * [DeadlineExceeded]
    await asyncio.sleep(1)
    with pytest.raises(ServerBusy):
        await client.call(Trigger.Request())
    await asyncio.sleep(1)
    with pytest.raises(DeadlineExceeded):
        await client.call(Trigger.Request())
    assert len(calls) == 4


async def test_call_to_the_robot_has_a_deadline_and_is_cancelled_with_its_caller(lab):
    cancelled = []

    async def hang(_, response):
        try:
            await asyncio.sleep(60)
        except asyncio.CancelledError:
            cancelled.append(asyncio.get_running_loop().time())
            raise

    lab.robot.create_service(Trigger, "/arm/open", hang)
    await asyncio.sleep(3 * LOOK)
    client = lab.laptop.create_client(Trigger, "/arm/open", timeout=None)
    began = asyncio.get_running_loop().time()
    limit = "/arm/open did not respond within 2 s, which is the gateway's --timeout; the call may"
    with pytest.raises(DeadlineExceeded, match=limit):
        await client.call(Trigger.Request())
    assert cancelled == [pytest.approx(began + 2.0, abs=0.1)]
    calling = asyncio.create_task(client.call(Trigger.Request()))
    await asyncio.sleep(0.5)
    calling.cancel()
    await asyncio.sleep(0.1)
    assert len(cancelled) == 2


async def test_open_call_ends_when_the_service_leaves_the_robot(lab):
    async def hang(_, response):
        await asyncio.sleep(60)

    lab.robot.create_service(Trigger, "/arm/open", hang)
    await asyncio.sleep(3 * LOOK)
    client = lab.laptop.create_client(Trigger, "/arm/open")
    calling = asyncio.create_task(client.call(Trigger.Request()))
    await asyncio.sleep(0.1)
    await lab.robot.destroy()
    with pytest.raises(OutcomeUnknown):
        await calling


async def test_name_that_is_taken_here_is_reported_once(lab, caplog):
    lab.laptop.create_service(Trigger, "/arm/open", hello)
    lab.robot.create_service(Trigger, "/arm/open", hello)
    await asyncio.sleep(6 * LOOK)
    assert caplog.text.count("cannot offer /arm/open: /arm/open is already offered") == 1


async def test_topic_flows_to_the_laptops_while_one_subscribes(lab):
    publisher = lab.robot.create_publisher(String, "/arm/status")
    lab.robot.create_publisher(String, "/secret")
    await asyncio.sleep(3 * LOOK)
    assert publisher.get_subscription_count() == 0
    got = asyncio.Queue()
    subscription = lab.laptop.create_subscription(String, "/arm/status", got.put_nowait)
    secret = lab.laptop.create_subscription(String, "/secret", got.put_nowait)
    await asyncio.sleep(3 * LOOK)
    publisher.publish(String(data="open"))
    assert (await got.get()).data == "open"
    assert secret.get_publisher_count() == 0
    subscription.destroy()
    await asyncio.sleep(3 * LOOK)
    assert publisher.get_subscription_count() == 0


async def test_topic_that_ends_on_the_robot_ends_here(lab):
    publisher = lab.robot.create_publisher(String, "/arm/status")
    subscription = lab.laptop.create_subscription(String, "/arm/status", lambda _: None)
    await asyncio.sleep(3 * LOOK)
    assert subscription.get_publisher_count() == 1
    publisher.destroy()
    await asyncio.sleep(3 * LOOK)
    assert subscription.get_publisher_count() == 0


async def test_topic_whose_type_is_not_known_here_is_reported_once(lab, caplog):
    door = srvgen.define("door_msgs/msg/Door", "int32 angle\n")
    lab.robot.create_publisher(door, "/arm/status")
    await asyncio.sleep(6 * LOOK)
    assert caplog.text.count("cannot offer /arm/status: ") == 1


BEST_EFFORT = taskrpc.QoS(reliability="best_effort")


@pytest.mark.parametrize("order", [(taskrpc.QoS(), BEST_EFFORT), (BEST_EFFORT, taskrpc.QoS())])
async def test_reliable_laptop_gets_the_messages_of_all_publishers(lab, order):
    publishers = [lab.robot.create_publisher(String, "/arm/status", qos) for qos in order]
    got = []
    lab.laptop.create_subscription(String, "/arm/status", lambda each: got.append(each.data))
    await asyncio.sleep(4 * LOOK)
    for number, publisher in enumerate(publishers):
        publisher.publish(String(data=str(number)))
    await asyncio.sleep(1)
    assert sorted(got) == ["0", "1"]


async def test_publisher_that_joins_with_best_effort_is_received_too(lab):
    first = lab.robot.create_publisher(String, "/arm/status")
    got = []
    lab.laptop.create_subscription(String, "/arm/status", lambda each: got.append(each.data))
    await asyncio.sleep(4 * LOOK)
    second = lab.robot.create_publisher(String, "/arm/status", BEST_EFFORT)
    await asyncio.sleep(3 * LOOK)
    for number, publisher in enumerate((first, second)):
        publisher.publish(String(data=str(number)))
    await asyncio.sleep(1)
    assert sorted(got) == ["0", "1"]


async def test_latched_messages_of_the_robot_reach_later_laptops(lab):
    latched = taskrpc.QoS(1, durability="transient_local")
    lab.robot.create_publisher(String, "/arm/status", latched).publish(String(data="map"))
    await asyncio.sleep(3 * LOOK)
    got = asyncio.Queue()
    lab.laptop.create_subscription(String, "/arm/status", got.put_nowait, latched)
    assert (await got.get()).data == "map"


async def test_type_that_the_robot_cannot_use_is_logged_once_for_the_operator(lab, caplog):
    def refuse(deferred):
        deferred.fail(TypeMismatch("ROS has not built the package arm_msgs"))

    lab.robot.create_deferred_service(Trigger, "/arm/open", refuse)
    await asyncio.sleep(3 * LOOK)
    client = lab.laptop.create_client(Trigger, "/arm/open")
    for _ in range(2):
        with pytest.raises(TypeMismatch, match="has not built the package arm_msgs"):
            await client.call(Trigger.Request())
    assert caplog.text.count("cannot call /arm/open: ROS has not built the package arm_msgs") == 1
