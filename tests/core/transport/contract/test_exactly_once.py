"""A request runs once, however often its connection is lost or its server restarts."""

from __future__ import annotations

import asyncio

import taskrpc
from tests.core.transport.helpers import Add, Gate, add, ask, outcome, until


def cut(client):
    """End the connections of a client at once, as if a cable were pulled."""
    for connection in list(client._channel._endpoint.dialler.connections):
        connection.transport.abort()


async def counted(net, store, calls):
    """A client of an exactly-once service that records its calls."""

    def callback(request, response):
        calls.append(request.a)
        return add(request, response)

    server = await net.node()
    server.create_service(Add, "once", callback, exactly_once=store)
    client = await net.client(Add, "once")
    assert await client.wait_for_service(60)
    return server, client


async def test_calls_run_once_while_connections_are_lost(net):
    calls, results = [], []
    _, client = await counted(net, taskrpc.MemoryCompletions(), calls)

    async def work(number):
        results.append((await client.call(ask(number))).sum)

    async with asyncio.TaskGroup() as group:
        for number in range(40):
            group.create_task(work(number))
            if number % 8 == 7:
                await asyncio.sleep(0)
                cut(client)
                await asyncio.sleep(0)  # what arrived before the cut becomes a result
                await asyncio.sleep(0)
                known = len(results)
                # The next connection must not be cut in its handshake: that counts as an attempt.
                await until(lambda known=known: len(results) > known)
    assert sorted(results) == list(range(40))
    assert sorted(calls) == list(range(40))


async def test_a_request_sent_again_after_a_restart_gets_its_stored_response(net):
    store, calls = taskrpc.MemoryCompletions(), []
    server, client = await counted(net, store, calls)
    first = await client.call(ask(1, 2), request_id="order 1")
    await server.destroy()
    again = await net.node("again")
    again.create_service(Add, "once", lambda *_: 1 / 0, exactly_once=store)
    assert await client.wait_for_service(60)
    assert await client.call(ask(1, 2), request_id="order 1") == first
    assert calls == [1]


async def test_a_call_without_these_promises_is_not_repeated_after_a_lost_connection(net):
    gate = Gate()
    server = await net.node()
    server.create_service(Add, "gate", gate)
    client = await net.client(Add, "gate")
    await client.wait_for_service(60)
    call = client.call_async(ask(1))
    await until(lambda: gate.started)
    cut(client)
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
    await until(lambda: gate.cancelled)
    gate.opened.set()
    assert (await client.call(ask(2))).sum == 2
    assert gate.started == [1, 2]
