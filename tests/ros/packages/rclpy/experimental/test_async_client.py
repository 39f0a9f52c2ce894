"""A client of an AsyncNode awaits responses, and its calls end with it."""

import asyncio

import pytest

from taskrpc.errors import HandlerFailed
from tests.ros.packages.rclpy.living import PATIENCE, AddTwoInts, add

pytestmark = pytest.mark.real_time

Request = AddTwoInts.Request


async def test_a_call_returns_the_response(create):
    async with create("server") as server, create("caller") as caller:
        server.create_service(AddTwoInts, "add", add)
        client = caller.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        assert (await client.call(Request(a=1, b=2))).sum == 3


async def test_each_of_several_calls_gets_its_own_response(create):
    together = asyncio.Barrier(3)

    async def callback(request, response):
        await together.wait()
        return add(request, response)

    async with create() as node:
        node.create_service(AddTwoInts, "add", callback, concurrent=True)
        client = node.create_client(AddTwoInts, "add")
        answers = await asyncio.gather(*[client.call(Request(a=number)) for number in range(3)])
    assert [answer.sum for answer in answers] == [0, 1, 2]


async def test_waiting_for_a_missing_service_ends_with_its_timeout(create):
    async with create() as node:
        client = node.create_client(AddTwoInts, "nobody")
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.02):
                await client.wait_for_service(check_interval=0.005)


async def test_a_call_works_after_another_call_timed_out(create):
    waits = [True, False]

    async def callback(request, response):
        if waits.pop(0):
            await asyncio.Event().wait()
        return add(request, response)

    async with create() as node:
        node.create_service(AddTwoInts, "add", callback, concurrent=True)
        client = node.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await client.call(Request())
        assert client.pending_futures == []
        assert (await client.call(Request(a=1))).sum == 1


async def test_destroy_cancels_a_call(create):
    async with create() as node:
        client = node.create_client(AddTwoInts, "nobody")
        call = asyncio.create_task(client.call(Request()))
        await asyncio.sleep(0)
        client.destroy()
        client.destroy()
        with pytest.raises(asyncio.CancelledError):
            await call
        with pytest.raises(RuntimeError, match="destroyed client"):
            await client.call(Request())


async def test_a_call_of_a_failing_callback_raises_its_error(create):
    def callback(request, response):
        raise ValueError("no wheels")

    server = create("server")
    server.create_service(AddTwoInts, "add", callback)
    running = asyncio.create_task(server.run())
    async with create("caller") as caller:
        client = caller.create_client(AddTwoInts, "add")
        with pytest.raises(HandlerFailed, match="no wheels"):
            await asyncio.wait_for(client.call(Request()), PATIENCE)
    with pytest.raises(ExceptionGroup) as raised:
        await running
    assert raised.group_contains(ValueError)


async def test_a_request_of_another_type_is_refused(create):
    async with create() as node:
        with pytest.raises(TypeError):
            await node.create_client(AddTwoInts, "add").call("text")
