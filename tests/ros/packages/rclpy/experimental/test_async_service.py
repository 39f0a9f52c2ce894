"""A service of an AsyncNode answers one request after another, or several at once."""

import asyncio

import pytest

import srvgen
from taskrpc.errors import TaskRpcError

pytestmark = pytest.mark.real_time

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
Request = AddTwoInts.Request


async def test_requests_wait_while_a_callback_awaits_something(create):
    running, most = 0, 0

    async def callback(request, response):
        nonlocal running, most
        running += 1
        most = max(most, running)
        await asyncio.sleep(0.001)
        running -= 1
        return response

    async with create() as node:
        node.create_service(AddTwoInts, "add", callback)
        client = node.create_client(AddTwoInts, "add")
        await asyncio.gather(*[client.call(Request()) for _ in range(3)])
    assert most == 1


@pytest.mark.parametrize("concurrent", [False, True])
async def test_an_exception_of_a_callback_ends_the_node(create, concurrent):
    async def callback(request, response):
        raise ValueError("no wheels")

    node = create()
    node.create_service(AddTwoInts, "add", callback, concurrent=concurrent)
    with pytest.raises(ExceptionGroup) as raised:
        async with node:
            await node.create_client(AddTwoInts, "add").call(Request())
    assert raised.group_contains(ValueError)


@pytest.mark.parametrize("concurrent", [False, True])
async def test_the_end_of_the_node_cancels_its_callbacks(create, concurrent):
    began, cancelled = asyncio.Event(), asyncio.Event()

    async def callback(request, response):
        began.set()
        try:
            await asyncio.Event().wait()
        finally:
            cancelled.set()
        return response

    async with create("server") as server, create("caller") as caller:
        server.create_service(AddTwoInts, "add", callback, concurrent=concurrent)
        client = caller.create_client(AddTwoInts, "add")
        call = asyncio.create_task(client.call(Request()))
        await began.wait()
        server.destroy_node()
        await cancelled.wait()
        with pytest.raises(TaskRpcError):  # in ROS, this call would wait for ever
            await call


async def test_a_destroyed_service_is_withdrawn(create):
    async with create() as node:
        service = node.create_service(AddTwoInts, "add", lambda _, response: response)
        client = node.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        service.destroy()
        service.destroy()
        while client.service_is_ready():
            await asyncio.sleep(0.001)
