"""Native topics: messages as rmw_zenoh sends them, in both directions."""

from __future__ import annotations

import asyncio
import gc
import weakref

import pytest

import srvgen
import taskrpc
from taskrpc import QoS
from taskrpc.core.wire.messages import TopicEndpoint
from taskrpc.middleware.zenoh import attachment, keys
from taskrpc.middleware.zenoh.tokens import Kind
from tests.core.transport.helpers import until
from tests.middleware.zenoh.helpers import GID

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")
Int32 = srvgen.load("std_msgs/msg/Int32")
HELLO = bytes.fromhex("000100000600000068656c6c6f00")


async def test_messages_are_those_of_rmw_zenoh(node, foreign):
    got = []
    key = foreign.show_topic(Kind.SUBSCRIPTION, "/text", String)
    subscriber = foreign.session.declare_subscriber(
        key, lambda sample: got.append((sample.payload.to_bytes(), sample.attachment.to_bytes()))
    )
    publisher = node.create_publisher(String, "text")
    await until(publisher.get_subscription_count)
    await until(lambda: publisher.publish(String(data="hello")) or len(got) >= 2)
    subscriber.undeclare()
    (data, about), (_, later) = got[:2]
    assert data == HELLO
    first, second = attachment.parse(about), attachment.parse(later)
    assert second.sequence == first.sequence + 1
    assert first.gid == second.gid


async def test_messages_of_foreign_publishers_arrive_and_gaps_count_as_lost(node, foreign):
    got = []
    subscription = node.create_subscription(String, "text", got.append)
    key = foreign.show_topic(Kind.PUBLISHER, "/text", String)
    await until(subscription.get_publisher_count)
    for sequence in (1, 2, 5):
        foreign.session.put(key, HELLO, attachment=attachment.pack(sequence, 1, GID))
    foreign.session.put(key, HELLO)  # without an attachment
    await until(lambda: len(got) == 4)
    assert got == [String(data="hello")] * 4
    assert subscription._receiver.lost == 2


async def test_invalid_messages_are_dropped(node, foreign, caplog):
    got = []
    subscription = node.create_subscription(String, "text", got.append)
    key = foreign.show_topic(Kind.PUBLISHER, "/text", String)
    await until(subscription.get_publisher_count)
    for data in (b"", b"garbage", HELLO[:-3], HELLO):
        foreign.session.put(key, data)
    await until(lambda: got)
    assert got == [String(data="hello")]


async def test_a_late_subscription_gets_the_last_messages_of_a_latched_publisher(
    node, zenoh_router
):
    import taskrpc

    latched = taskrpc.QoS(2, durability="transient_local")
    publisher = node.create_publisher(String, "text", latched)
    for text in "abc":
        publisher.publish(String(data=text))
    await asyncio.sleep(0.1)  # messages on their way would be no earlier ones
    async with taskrpc.Node("late", transport="zenoh", peers=[zenoh_router], listen="x") as late:
        got = []
        late.create_subscription(String, "text", lambda message: got.append(message.data), latched)
        await until(lambda: len(got) >= 2)
        publisher.publish(String(data="d"))
        await until(lambda: len(got) >= 3)
        assert got == ["b", "c", "d"]


async def test_different_types_are_reported_and_exchange_nothing(node, foreign, caplog):
    got = []
    subscription = node.create_subscription(Int32, "text", got.append)
    foreign.show_topic(Kind.PUBLISHER, "/text", String)
    await until(lambda: caplog.messages)
    (message,) = caplog.messages
    assert message.startswith("/foreign publishes /text as std_msgs/msg/String with the hash")
    assert "/here subscribes to it as std_msgs/msg/Int32" in message
    assert subscription.get_publisher_count() == 0


async def test_tokens_show_the_profile_of_a_topic(node, foreign):
    qos = QoS(3, "best_effort", "transient_local")
    node.create_publisher(String, "text", qos)
    tokens = []

    def look():
        replies = foreign.session.liveliness().get("@ros2_lv/0/**")
        tokens[:] = [str(reply.ok.key_expr) for reply in replies]
        return [each for each in tokens if "/MP/" in each]

    await until(look)
    (shown,) = look()
    assert shown.endswith("2:1:,3:,:,:,,")
    assert keys.dds_type(String._TYPE) in shown
    assert any("/NN/%/%/here" in each for each in tokens)


@pytest.mark.parametrize(
    ("offered", "wanted"),
    [(QoS(reliability="best_effort"), QoS()), (QoS(), QoS(durability="transient_local"))],
)
async def test_all_qos_profiles_are_compatible(zenoh_router, node, caplog, offered, wanted):
    """As with rmw_zenoh; over DDS and over taskrpc's own topics these do not match."""
    got, told = [], []
    async with taskrpc.Node("there", transport="zenoh", peers=[zenoh_router]) as there:
        publisher = there.create_publisher(String, "text", offered, on_mismatch=told.append)
        node.create_subscription(String, "text", got.append, wanted, on_mismatch=told.append)
        await until(publisher.get_subscription_count)
        publisher.publish(String(data="hello"))
        await until(lambda: got)
    assert (told, caplog.messages) == ([], [])


class Deliver:
    """Gets messages; an object that a weak reference can follow."""

    def __call__(self, body, number):
        pass


async def test_a_closed_subscription_refers_to_nothing_of_the_program(node):
    """Zenoh 1.7 keeps the handler of a transient_local subscription, and so the subscription."""
    engine, deliver = node._transport.network._native_engine, Deliver()
    named = TopicEndpoint("/text", String._TYPE, String._HASH, "/here", 1, True, True)
    subscription = engine.create_subscription(named, String, deliver, None)
    kept = weakref.ref(deliver)
    subscription.close()
    del deliver
    gc.collect()
    assert kept() is None
    assert subscription.named is named
