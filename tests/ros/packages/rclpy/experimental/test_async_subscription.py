"""A subscription of an AsyncNode passes messages to functions and coroutine functions."""

import asyncio

import pytest

import srvgen

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")


async def test_messages_arrive_in_order_and_one_at_a_time(create):
    received, full = [], asyncio.Event()

    async def callback(message):
        received.append(f"begin {message.data}")
        await asyncio.sleep(0)
        received.append(f"end {message.data}")
        if len(received) == 4:
            full.set()

    async with create() as node:
        node.create_subscription(String, "chat", callback, 10)
        publisher = node.create_publisher(String, "chat", 10)
        for word in "ab":
            publisher.publish(String(data=word))
        await full.wait()
    assert received == ["begin a", "end a", "begin b", "end b"]


async def test_concurrent_callbacks_wait_for_each_other(create):
    together, done = asyncio.Barrier(3), asyncio.Event()

    async def callback(_):
        await together.wait()
        done.set()

    async with create() as node:
        node.create_subscription(String, "chat", callback, 10, concurrent=True)
        publisher = node.create_publisher(String, "chat", 10)
        for _ in range(3):
            publisher.publish(String())
        await done.wait()


@pytest.mark.parametrize("concurrent", [False, True])
async def test_an_exception_of_a_callback_ends_the_node(create, concurrent):
    async def callback(_):
        raise ValueError("no ears")

    node = create()
    node.create_subscription(String, "chat", callback, 10, concurrent=concurrent)
    node.create_publisher(String, "chat", 10).publish(String())
    with pytest.raises(ExceptionGroup) as raised:
        await node.run()
    assert raised.group_contains(ValueError)


async def test_callbacks_get_bytes_and_the_info_of_a_message(create):
    received = asyncio.Queue()
    async with create() as node:
        node.create_subscription(
            String, "chat", lambda *both: received.put_nowait(both), 10, raw=True
        )

        async def callback(message, info):
            await received.put((message, info))

        node.create_subscription(String, "chat2", callback, 10)
        node.create_publisher(String, "chat", 10).publish(String(data="x"))
        assert isinstance((await received.get())[0], bytes)
        node.create_publisher(String, "chat2", 10).publish(String(data="x"))
        message, info = await received.get()
    assert message.data == "x"
    assert info["source_timestamp"] > 0


async def test_a_destroyed_subscription_receives_nothing(create):
    received, other = [], asyncio.Event()
    async with create() as node:
        first = node.create_subscription(String, "chat", received.append, 10)
        node.create_subscription(String, "chat", lambda _: other.set(), 10)
        first.destroy()
        first.destroy()
        node.create_publisher(String, "chat", 10).publish(String())
        await other.wait()
    assert received == []
