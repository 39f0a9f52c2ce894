"""Contract: every client that waits for a service wakes when the service is available."""

import asyncio

import pytest

import taskrpc
from tests.core.transport.helpers import (
    Add,
    Gate,
    add,
    ask,
    served,
    until,
)

# Waiting for a service


async def test_wait_returns_false_at_its_timeout(net):
    client = await net.client(Add, "nobody")
    began = asyncio.get_running_loop().time()
    assert not await client.wait_for_service(0.2)
    assert 0.198 <= asyncio.get_running_loop().time() - began < (0.21 if net.is_virtual else 2)
    assert not await client.wait_for_service(0)


async def test_a_waiting_client_is_woken_when_the_server_starts(net):
    for delay in (0, 0.001, 0.039, 0.041, 0.1):
        client = await net.client(Add, f"late{delay * 1000:.0f}")
        waiting = asyncio.create_task(client.wait_for_service(None))
        await asyncio.sleep(delay)
        server = await net.node()
        server.create_service(Add, client.service_name, add)
        async with asyncio.timeout(60):
            assert await waiting
        assert (await client.call(ask(1, 1))).sum == 2


async def test_many_waiters_are_all_woken(net):
    node = await net.node("waiters")
    clients = [node.create_client(Add, "late") for _ in range(20)]
    waiting = [asyncio.create_task(c.wait_for_service(None)) for c in clients for _ in range(10)]
    await asyncio.sleep(0.05)
    server = await net.node()
    server.create_service(Add, "late", add)
    async with asyncio.timeout(60):
        assert all(await asyncio.gather(*waiting))


async def test_a_waiting_client_wakes_after_others_have_stopped_waiting(net):
    client = await net.client(Add, "late")
    waiting = [asyncio.create_task(client.wait_for_service(None)) for _ in range(4)]
    await asyncio.sleep(0.02)
    for task in waiting[:3]:
        task.cancel()
    assert not await client.wait_for_service(0.02)
    server = await net.node()
    server.create_service(Add, "late", add)
    async with asyncio.timeout(60):
        assert await waiting[3]


async def test_client_finds_a_restarted_server(net):
    client = await net.client(Add, "add")
    for _ in range(3):
        server = await net.node()
        server.create_service(Add, "add", add)
        assert await client.wait_for_service(60)
        assert (await client.call(ask(1, 1))).sum == 2
        await server.destroy()
        await until(lambda: not client.service_is_ready())


async def test_a_waiter_learns_that_its_client_was_destroyed(net):
    client = await net.client(Add, "nobody")
    waiting = asyncio.create_task(client.wait_for_service(None))
    await asyncio.sleep(0.02)
    client.destroy()
    async with asyncio.timeout(60):
        assert await waiting is False
    with pytest.raises(taskrpc.TaskRpcError, match="the client of /nobody is destroyed"):
        await client.call(ask())


async def test_calls_in_flight_of_a_destroyed_client_still_get_their_answers(net):
    gate = Gate()
    _, client = await served(net, gate)
    call = client.call_async(ask(1))
    await until(lambda: gate.started)
    client.destroy()
    client.destroy()
    gate.opened.set()
    assert (await call).sum == 1
