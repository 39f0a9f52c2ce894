"""Metrics count messages, also of publishers and nodes that have ended."""

import asyncio

import srvgen
import taskrpc

Int32 = srvgen.load("std_msgs/msg/Int32")


def values(metrics):
    """Every sample of a topic: by family without `taskrpc_topic_`, and place of loss."""
    found = {}
    for family in metrics.families():
        if family.name.startswith("taskrpc_topic_"):
            for sample in family.samples:
                assert sample.labels["topic"] == "/counts"
                name = family.name.removeprefix("taskrpc_topic_")
                found[name, sample.labels.get("where", "")] = sample.value
    return found


async def test_messages_are_counted_with_their_losses_and_by_topic():
    metrics, gate = taskrpc.Metrics(), asyncio.Event()

    async def slow(message):
        await gate.wait()

    node = taskrpc.Node("both", transport="memory", observer=metrics)
    await node.start()
    publisher = node.create_publisher(Int32, "counts")
    node.create_subscription(Int32, "counts", slow, 2)
    for number in range(10):
        publisher.publish(Int32(data=number))
        await asyncio.sleep(0)
    told = values(metrics)
    assert told["published_total", ""] == told["received_total", ""] == 10
    assert told["lost_total", "waiting"] == 7
    assert told["lost_total", "sending"] == told["lost_total", "coming"] == 0
    assert told["subscriptions", ""] == told["publishers", ""] == 1
    publisher.destroy()
    told = values(metrics)
    assert told["published_total", ""] == 10
    assert told["subscriptions", ""] == told["publishers", ""] == 0
    node.create_publisher(Int32, "counts").publish(Int32())
    assert values(metrics)["published_total", ""] == 11
    await node.destroy()
    assert values(metrics)["published_total", ""] == 11
    assert values(metrics)["received_total", ""] == 11
