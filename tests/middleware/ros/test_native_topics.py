"""Topics on a fake rclpy."""

from __future__ import annotations

import asyncio

import pytest

import srvgen
from taskrpc.core.transport.tunnel.handoff import Handoff
from taskrpc.core.wire.messages import TopicEndpoint
from taskrpc.errors import InvalidRequest
from taskrpc.middleware.ros.native_topics import Carrier, NativePublisher, NativeSubscription
from taskrpc.middleware.ros.spinning import Ending
from tests.middleware.ros.fake_ros import ros_message

String = srvgen.load("std_msgs/msg/String")
NAMED = TopicEndpoint("/chat", "std_msgs/msg/String", "", "/n", 10, True, False)
LATCHED = TopicEndpoint("/chat", "std_msgs/msg/String", "", "/n", 10, True, True)


class Pair:
    """A publisher and a subscription of /chat."""

    def __init__(self, ros, *, is_built=True, named=NAMED):
        handoff = Handoff(asyncio.get_running_loop())
        node = ros.new_node("node")
        self.carrier = Carrier(
            ros, String, ros_message("std_msgs/msg/String") if is_built else None, object
        )
        self.got, self.mismatches, self.node, self.ros = [], [], node, ros
        self.publisher = NativePublisher(ros, node, named, self.carrier, None, handoff, Ending())
        self.subscribe = lambda: NativeSubscription(
            ros, node, named, self.carrier, self.arrived, self.mismatches.append, handoff
        )
        self.subscription = self.subscribe()
        self.waited = ros.topics[self.carrier.topic("/chat")][0].waited

    def arrived(self, body, number):
        self.got.append((self.carrier.decode(body).data, number))

    def publish(self, text):
        self.publisher.publish(self.publisher.encode(String(data=text)))


@pytest.mark.parametrize("is_built", [True, False])
async def test_messages_arrive(ros, is_built):
    pair = Pair(ros, is_built=is_built)
    pair.publish("one")
    pair.publish("zwei ä")
    await asyncio.sleep(0)
    assert pair.got == [("one", 1), ("zwei ä", 2)]
    assert (pair.publisher.sent, pair.publisher.matched, pair.subscription.matched) == (2, 1, 1)


async def test_type_that_ros_has_not_built_has_a_hidden_topic(ros):
    pair = Pair(ros, is_built=False)
    topic = pair.carrier.topic("/chat")
    assert topic == f"/_taskrpc/topic_{String._HASH[-16:]}/chat"
    assert [each for each in ros.topics if ros.topics[each]] == [topic]


async def test_ends_of_a_topic_report_their_matches(ros):
    pair = Pair(ros)
    seen = []
    pair.publisher.on_matched = lambda: seen.append("publisher")
    pair.subscribe()
    await asyncio.sleep(0)
    assert "publisher" in seen


async def test_mismatch_is_reported_with_its_policy(ros):
    pair = Pair(ros)
    end = ros.topics["/chat"][1]
    status = type("Status", (), {"last_policy_kind": "DURABILITY"})
    end.events.incompatible_qos(status)
    await asyncio.sleep(0)
    assert pair.mismatches == ["DURABILITY"]


async def test_mismatch_is_logged_without_a_callback(ros, caplog):
    Pair(ros)
    status = type("Status", (), {"last_policy_kind": "RELIABILITY"})
    ros.topics["/chat"][0].events.incompatible_qos(status)
    await asyncio.sleep(0)
    assert "New subscription discovered on topic '/chat', requesting incompatible" in caplog.text


async def test_another_type_is_reported(ros):
    pair = Pair(ros)
    ros.topics["/chat"][1].events.incompatible_type(None)
    await asyncio.sleep(0)
    assert pair.mismatches == ["TYPE"]


async def test_lost_messages_are_counted(ros):
    pair = Pair(ros)
    ros.topics["/chat"][1].events.message_lost(type("Status", (), {"total_count": 3}))
    await asyncio.sleep(0)
    assert pair.subscription.lost == 3


async def test_message_that_dds_cannot_take_counts_as_lost(ros, caplog):
    pair = Pair(ros)

    def full(_):
        raise RuntimeError("no room")

    ros.topics["/chat"][0].publish = full
    pair.publish("x")
    assert (pair.publisher.sent, pair.publisher.lost) == (1, 1)
    assert "no room" in caplog.text


async def test_latched_messages_can_be_forgotten(ros):
    pair = Pair(ros, named=LATCHED)
    pair.publish("old")
    pair.subscribe()
    await asyncio.sleep(0)
    assert [text for text, _ in pair.got] == ["old", "old"]
    pair.publisher.forget_latched()
    pair.got.clear()
    pair.subscribe()
    await asyncio.sleep(0)
    assert pair.got == []


async def test_closed_ends_do_nothing(ros):
    pair = Pair(ros)
    pair.publish("on the way")
    pair.subscription.close()
    pair.publisher.close()
    pair.subscription.close()
    pair.publisher.close()
    pair.publish("late")
    pair.publisher.forget_latched()
    await asyncio.sleep(0)
    assert (pair.got, pair.publisher.matched, pair.subscription.matched) == ([], 0, 0)
    while ros.topics["/chat"]:  # the publisher ends in a thread
        await asyncio.to_thread(lambda: None)
    assert pair.waited == [0]


async def test_wrong_values_are_refused(ros):
    pair = Pair(ros)
    with pytest.raises(InvalidRequest, match="data"):
        pair.publisher.encode(String(data=3))
    with pytest.raises(InvalidRequest, match="expected a std_msgs/msg/String, got int"):
        pair.publisher.encode(3)


@pytest.mark.parametrize("is_built", [True, False])
async def test_garbage_raises_invalid_request(ros, is_built):
    with pytest.raises(InvalidRequest):
        Pair(ros, is_built=is_built).carrier.decode(b"garbage")


async def test_message_with_bytes_behind_its_end_is_decoded_by_ros(ros):
    pair = Pair(ros)
    ros.serialization.deserialize_message = lambda data, cls: cls(data="padded")
    assert pair.carrier.decode(srvgen.to_cdr(String(data="x")) + bytes(9)).data == "padded"
