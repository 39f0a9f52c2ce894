"""Topics of rosbridge clients: throttled, in fragments, with the right quality of service."""

import asyncio

import pytest

import srvgen
from taskrpc import QoS
from taskrpc.bridges.rosbridge import session
from tests.bridges.rosbridge.clients import connected

TEXT = srvgen.load("std_msgs/msg/String")
SUBSCRIBE = {"topic": "chatter", "type": "std_msgs/String"}


async def published(publisher, *texts, wait=0.0):
    while not publisher.get_subscription_count():
        await asyncio.sleep(0.1)
    for text in texts:
        publisher.publish(TEXT(data=str(text)))
        await asyncio.sleep(wait)
    await asyncio.sleep(0.1)


def texts(client):
    return [each["msg"]["data"] for each in client.sent if each["op"] == "publish"]


async def test_subscriber_gets_messages_under_the_name_that_it_used():
    async with connected() as (node, client):
        await client.send("subscribe", **SUBSCRIBE)
        await published(node.create_publisher(TEXT, "/chatter"), 1)
        expected = {"op": "publish", "topic": "chatter", "msg": {"data": "1"}}
        assert await client.next() == expected


async def test_type_of_a_known_topic_may_be_left_out():
    async with connected() as (node, client):
        publisher = node.create_publisher(TEXT, "/chatter")
        await client.send("subscribe", topic="/chatter")
        await published(publisher, 1)
        assert texts(client) == ["1"]
        await client.send("subscribe", topic="/unknown", id="u")
        problem = "subscribe: no program has the topic /unknown; give its type"
        assert await client.next(op="status") == {
            "op": "status",
            "level": "error",
            "msg": problem,
            "id": "u",
        }


@pytest.mark.parametrize(
    "qos", [QoS(1, "best_effort"), QoS(1, durability="transient_local"), QoS(5)]
)
async def test_subscription_matches_the_publishers_of_the_topic(qos):
    async with connected() as (node, client):
        publisher = node.create_publisher(TEXT, "/chatter", qos)
        publisher.publish(TEXT(data="early"))
        await client.send("subscribe", **SUBSCRIBE)
        await published(publisher, "later")
        assert texts(client) == ["early"] * qos.is_latched + ["later"]


async def test_two_subscriptions_get_each_message_once_until_both_have_ended():
    async with connected() as (node, client):
        await client.send("subscribe", id="a", **SUBSCRIBE)
        await client.send("subscribe", id="b", **SUBSCRIBE)
        publisher = node.create_publisher(TEXT, "/chatter")
        await published(publisher, 1)
        await client.send("unsubscribe", id="a", topic="/chatter")
        await published(publisher, 2)
        await client.send("unsubscribe", id="b", topic="/chatter")
        await asyncio.sleep(1)
        assert publisher.get_subscription_count() == 0
        assert texts(client) == ["1", "2"]


async def test_throttled_subscription_gets_one_message_a_period():
    async with connected() as (node, client):
        await client.send("subscribe", throttle_rate=1000, **SUBSCRIBE)
        await published(node.create_publisher(TEXT, "/chatter"), *range(9), wait=0.25)
        assert texts(client) == ["0", "4", "8"]


async def test_queue_of_a_throttled_subscription_is_sent_later():
    async with connected() as (node, client):
        await client.send("subscribe", throttle_rate=1000, queue_length=2, **SUBSCRIBE)
        await published(node.create_publisher(TEXT, "/chatter"), *range(5))
        assert texts(client) == ["0"]
        await asyncio.sleep(3)
        assert texts(client) == ["0", "3", "4"]


async def test_fastest_subscription_of_a_topic_decides_its_rate():
    async with connected() as (node, client):
        await client.send("subscribe", id="slow", throttle_rate=1000, **SUBSCRIBE)
        await client.send("subscribe", id="fast", throttle_rate=0, **SUBSCRIBE)
        publisher = node.create_publisher(TEXT, "/chatter")
        await published(publisher, 1, 2)
        await client.send("unsubscribe", id="fast", topic="/chatter")
        await published(publisher, 3, 4)
        assert texts(client) == ["1", "2", "3"]


async def test_long_messages_are_sent_in_fragments():
    async with connected() as (node, client):
        await client.send("subscribe", fragment_size=100, **SUBSCRIBE)
        await published(node.create_publisher(TEXT, "/chatter"), "x" * 300)
        parts = [each["data"] for each in client.sent if each["op"] == "fragment"]
        assert len(parts) == 4
        assert "".join(parts).endswith('"}}')


async def test_client_that_is_behind_gets_only_the_newest_message():
    async with connected() as (node, client):
        await client.send("subscribe", **SUBSCRIBE)
        publisher = node.create_publisher(TEXT, "/chatter")
        client.behind = True
        await published(publisher, *range(100))
        assert texts(client) == []
        client.behind = False
        client.session.drained()
        assert texts(client) == ["99"]


async def test_messages_published_at_once_after_advertise_arrive():
    async with connected() as (node, client):
        got = []
        node.create_subscription(TEXT, "/chatter", lambda message: got.append(message.data))
        await client.send("advertise", **SUBSCRIBE)
        for number in range(3):
            await client.send("publish", topic="chatter", msg={"data": str(number)})
        await asyncio.sleep(2)
        assert got == ["0", "1", "2"]


async def test_topic_that_exists_needs_no_advertise():
    async with connected() as (node, client):
        got = []
        node.create_subscription(TEXT, "/chatter", lambda message: got.append(message.data))
        await client.send("publish", topic="/chatter", msg={"data": "1"})
        await asyncio.sleep(2)
        assert got == ["1"]
        await client.send("publish", topic="/unknown", msg={"data": "1"})
        assert "the type of /unknown is unknown" in (await client.next())["msg"]


async def test_client_that_reconnects_may_publish_without_advertising_again():
    async with connected(2) as (_, client, again):
        await client.send("advertise", **SUBSCRIBE)
        client.session.close()
        await again.send("publish", topic="/chatter", msg={"data": "1"})
        assert again.sent == []
        again.session.close()
        await asyncio.sleep(10)
        await client.send("publish", topic="/chatter", msg={"data": "1"})
        assert "the type of /chatter is unknown" in (await client.next())["msg"]


async def test_latched_message_reaches_later_subscriptions():
    async with connected() as (node, client):
        await client.send("advertise", latch=True, **SUBSCRIBE)
        await client.send("publish", topic="chatter", msg={"data": "1"})
        await asyncio.sleep(2)
        got = []
        qos = QoS(1, durability="transient_local")
        node.create_subscription(TEXT, "/chatter", lambda message: got.append(message.data), qos)
        await asyncio.sleep(2)
        assert got == ["1"]


async def test_topic_of_another_type_is_refused():
    async with connected() as (node, client):
        node.create_publisher(TEXT, "/chatter")
        await client.send("advertise", topic="/chatter", type="std_msgs/Bool")
        problem = "the topic /chatter has the type std_msgs/msg/String, not std_msgs/Bool"
        assert problem in (await client.next())["msg"]
        await client.send("advertise", topic="/x", type="std_srvs/srv/Trigger")
        assert "expected a message type" in (await client.next())["msg"]


async def test_message_that_does_not_fit_is_refused():
    async with connected() as (_, client):
        await client.send("advertise", **SUBSCRIBE)
        await client.send("publish", topic="chatter", msg={"data": 5}, id="p")
        status = await client.next()
        assert (status["id"], status["msg"]) == (
            "p",
            "publish: data: expected string, got 5 (int)",
        )


async def test_unadvertised_topic_has_no_publisher_any_more():
    async with connected() as (node, client):
        got = []
        subscription = node.create_subscription(TEXT, "/chatter", got.append)
        await client.send("advertise", id="a", **SUBSCRIBE)
        await client.send("advertise", id="b", **SUBSCRIBE)
        for name, left in (("a", 1), ("b", 0)):
            await client.send("unadvertise", topic="chatter", id=name)
            await asyncio.sleep(1)
            assert subscription.get_publisher_count() == left


async def test_unknown_compression_is_a_warning():
    async with connected() as (_, client):
        await client.send("set_level", level="warning")
        await client.send("subscribe", compression="png", **SUBSCRIBE)
        assert "no compression png" in (await client.next())["msg"]


async def test_number_of_topics_is_limited(monkeypatch):
    monkeypatch.setattr(session, "MAX_TOPICS", 1)
    async with connected() as (_, client):
        for verb in ("subscribe", "advertise"):
            for topic in ("/a", "/b"):
                await client.send(verb, topic=topic, type="std_msgs/String")
            assert "expected at most 1 " in (await client.next())["msg"]
