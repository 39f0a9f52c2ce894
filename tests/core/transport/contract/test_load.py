"""Contract: order, limits and slow peers under load; nothing is left behind."""

import asyncio
import gc

import taskrpc
from taskrpc.core.wire.messages import DEFAULT_LIMITS
from tests.core.transport.helpers import (
    FAST,
    Add,
    Gate,
    Text,
    add,
    ask,
    outcome,
    served,
    until,
)

# Order and load


async def test_one_at_a_time_and_in_order_of_arrival(net):
    running, order = [], []

    async def one(request, response):
        assert not running
        running.append(request.a)
        await asyncio.sleep(0.001)
        order.append(running.pop())
        return response

    _, client = await served(net, one)
    await asyncio.gather(*[client.call_async(ask(n)) for n in range(50)])
    assert order == list(range(50))


async def test_as_many_at_a_time_as_allowed(net):
    running, most = [], []

    async def several(request, response):
        running.append(1)
        most.append(len(running))
        await asyncio.sleep(0.001)
        running.pop()
        return response

    _, client = await served(net, several, concurrency=7)
    await asyncio.gather(*[client.call_async(ask(n)) for n in range(100)])
    assert max(most) == 7


async def test_plain_callbacks_that_wait_their_turn_do_not_starve_the_loop(net):
    _, client = await served(net)
    turns = 0

    async def count():
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    counter = asyncio.create_task(count())
    gathered = asyncio.gather(*[client.call_async(ask(n)) for n in range(200)])
    await gathered
    counter.cancel()
    assert turns > 2


async def test_a_full_queue_answers_busy_and_the_call_did_not_run(net, monkeypatch):
    monkeypatch.setattr("taskrpc.service.QUEUE_LIMIT", 5)
    gate = Gate()
    _, client = await served(net, gate)
    calls = [client.call_async(ask(n), timeout=None) for n in range(10)]
    errors = await asyncio.gather(*calls[6:], return_exceptions=True)
    assert {type(error) for error in errors} == {taskrpc.ServerBusy}
    assert all(error.not_executed and error.retry_after > 0 for error in errors)
    gate.opened.set()
    assert [each.sum for each in await asyncio.gather(*calls[:6])] == [0, 1, 2, 3, 4, 5]


async def test_calls_beyond_the_servers_limit_wait_in_the_client(net):
    gate = Gate()
    _, client = await served(net, gate, concurrency=10_000)
    calls = [client.call_async(ask(n), timeout=None) for n in range(600)]
    await until(lambda: len(gate.started) == DEFAULT_LIMITS.calls)
    await asyncio.sleep(0.05)
    assert gate.started == list(range(256))
    expired = client.call_async(ask(), timeout=0.05)
    error = await outcome(expired)
    assert isinstance(error, taskrpc.DeadlineExceeded)
    assert error.not_executed
    calls[500].cancel()
    gate.opened.set()
    got = await asyncio.gather(*calls, return_exceptions=True)
    assert [each.sum for n, each in enumerate(got) if n != 500] == [
        n for n in range(600) if n != 500
    ]
    assert 500 not in gate.started


async def test_another_service_is_found_while_all_places_in_flight_are_taken(net):
    gate = Gate()
    server, _ = await served(net, gate, "gate", concurrency=10_000)
    server.create_service(Add, "add", add)
    node = await net.node("caller")
    busy = node.create_client(Add, "gate")
    calls = [busy.call_async(ask(n), timeout=None) for n in range(256)]
    await until(lambda: len(gate.started) == 256)
    other = node.create_client(Add, "add")
    assert await other.wait_for_service(60)
    late = other.call_async(ask(1, 2), timeout=None)
    gate.opened.set()
    assert (await late).sum == 3
    assert len(await asyncio.gather(*calls)) == 256


async def test_more_than_the_byte_budget_waits_in_the_client(net, monkeypatch):
    arrived = []
    opened = asyncio.Event()

    async def hold(request, response):
        arrived.append(len(request.task_type))
        await opened.wait()
        return response

    _, client = await served(net, hold, "hold", Text, concurrency=100)
    request = Text.Request(task_type="x" * 10_000_000)
    calls = [client.call_async(request, timeout=None) for _ in range(9)]
    await until(lambda: len(arrived) == 6, 30)
    await asyncio.sleep(0.05)
    assert len(arrived) == 6  # 64 MiB
    opened.set()
    assert len(await asyncio.gather(*calls)) == 9


# Slow peers


async def test_a_caller_that_does_not_read_is_held_back(net):
    begun = []

    def big(request, response):
        begun.append(1)
        response.message = "x" * 1_000_000
        return response

    _, client = await served(net, big, "big", Text)
    transport = client._channel._connection.transport
    transport.pause_reading()
    calls = [client.call_async(Text.Request(), timeout=None) for _ in range(200)]
    await asyncio.sleep(0.2)
    assert 0 < len(begun) < 20
    transport.resume_reading()
    assert len(await asyncio.gather(*calls)) == 200


async def test_a_server_that_does_not_read_holds_the_callers_back(net):
    server, client = await served(net, lambda request, response: response, "sink", Text)
    serving = next(iter(server._transport._served))
    serving.transport.pause_reading()
    connection = client._channel._connection
    request = Text.Request(task_type="x" * 100_000)
    calls = [client.call_async(request, timeout=None) for _ in range(200)]
    await asyncio.sleep(0.05)
    unread = connection.transport.get_write_buffer_size()
    assert unread < 1_000_000
    serving.transport.resume_reading()
    assert len(await asyncio.gather(*calls)) == 200


# Nothing is left


async def test_random_cancels_leave_nothing(net):
    import random

    chance = random.Random(7)
    gate = Gate()
    server, client = await served(net, gate, concurrency=300)
    connection = client._channel._connection
    for _ in range(5):
        calls = [client.call_async(ask(n), timeout=chance.choice([None, 5, 9])) for n in range(500)]
        chance.shuffle(calls)
        for n, call in enumerate(calls):
            if n % 100 == 0:
                await asyncio.sleep(0)
            call.cancel()
    await until(lambda: not connection.session.in_flight)
    serving = next(iter(server._transport._served))
    await until(lambda: not next(iter(server._services))._jobs)
    assert not serving.session.in_flight
    assert not connection._waiting
    assert not list(serving.expiring())
    assert not list(connection.expiring())
    gate.opened.set()
    assert (await client.call(ask(3))).sum == 3


async def test_destroyed_nodes_leave_no_task_timer_or_warning(net, caplog):
    before = asyncio.all_tasks()
    gate = Gate()
    async with (
        taskrpc.Node("s", **net.options("s")) as server,
        taskrpc.Node("c", **net.options("c")) as node,
    ):
        server.create_service(Add, "gate", gate, concurrency=3)
        server.create_service(Add, "thread", add, threaded=True)
        client = node.create_client(Add, "gate")
        await client.wait_for_service(60)
        calls = [client.call_async(ask(n)) for n in range(5)]
        await node.create_client(Add, "thread").call(ask())
        absent = node.create_client(Add, "absent", retry=FAST)
        calls.append(absent.call_async(ask()))
        waiting = asyncio.create_task(absent.wait_for_service(None))
        await until(lambda: len(gate.started) == 3)
    await asyncio.gather(*calls, waiting, return_exceptions=True)
    for _ in range(5):
        await asyncio.sleep(0)
    gc.collect()
    assert asyncio.all_tasks() == before
    if hasattr(asyncio.get_running_loop(), "_scheduled"):
        live = [each for each in asyncio.get_running_loop()._scheduled if not each.cancelled()]
        assert [each for each in live if "taskrpc" in repr(each)] == []
    assert [each for each in caplog.records if each.name == "asyncio"] == []


async def test_a_refused_connection_fails_all_calls_that_wait_for_it(net):
    server, client = await served(net)
    await server.destroy()
    results = await asyncio.gather(*[outcome(client.call(ask())) for _ in range(20)])
    assert {type(each) for each in results} == {taskrpc.ServiceUnavailable}
