"""A publisher of an AsyncNode works before the node runs, and not after its destruction."""

import asyncio

import pytest

import srvgen

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")


async def test_a_node_that_does_not_run_publishes(create):
    received = asyncio.Event()
    publisher = create("talker").create_publisher(String, "chat", 10)
    async with create("listener") as listener:
        listener.create_subscription(String, "chat", lambda _: received.set(), 10)
        while publisher.get_subscription_count() < 1:
            await asyncio.sleep(0.001)
        publisher.publish(String())
        await received.wait()


async def test_a_destroyed_publisher_publishes_nothing(create):
    node = create()
    with node.create_publisher(String, "chat", 10) as publisher:
        assert node.count_publishers("chat") == 1
    publisher.destroy()
    with pytest.raises(RuntimeError):
        publisher.publish(String())
