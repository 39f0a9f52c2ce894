"""Contract: services that start, end, drain and move; callbacks, names and the graph."""

import asyncio
import logging
import threading
import time

import pytest

import taskrpc
from taskrpc.client import Client
from taskrpc.core.wire.session import Session
from tests.core.transport.helpers import (
    Add,
    Gate,
    add,
    ask,
    outcome,
    served,
    until,
    until_seen,
)

# Services that come and go


async def until_offered_by(client, servers):
    """Return once the client's program knows so many servers of the service."""
    network = client._channel._endpoint.network
    await until(lambda: len(network.locate(client.service_name)) == servers)


async def test_a_service_withdrawn_and_offered_again_is_found_by_the_same_client(net):
    server, client = await served(net)
    for _ in range(3):
        service = list(server._services)[-1]
        service.destroy()
        with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /add"):
            await client.call(ask())
        await until(lambda: not client.service_is_ready())
        assert not await client.wait_for_service(0.1)
        server.create_service(Add, "add", add)
        assert await client.wait_for_service(60)
        assert client.service_is_ready()
        assert (await client.call(ask(2, 3))).sum == 5


async def test_a_destroyed_service_answers_the_calls_that_had_arrived(net):
    for options in ({}, {"threaded": True}):
        began, ends = threading.Event(), threading.Event()

        def slow(request, response, began=began, ends=ends):
            began.set()
            ends.wait(0.005)
            response.sum = request.a
            return response

        name = f"slow{len(options)}"
        server, client = await served(net, slow, name, **options)
        calls = [client.call_async(ask(n)) for n in range(5)]
        await until(began.is_set)
        await asyncio.sleep(0.01)
        list(server._services)[-1].destroy()
        assert [(await each).sum for each in calls] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("shared", [False, True])
async def test_a_destroyed_node_leaves_running_calls_with_an_unknown_outcome(net, shared):
    gate = Gate()
    server = await net.node("server", shared=shared)
    server.create_service(Add, "gate", gate, concurrency=5)
    client = (await net.node("client", shared=shared)).create_client(Add, "gate")
    calls = [client.call_async(ask(n), timeout=None) for n in range(10)]
    await until(lambda: len(gate.started) == 5)
    await server.destroy()
    errors = await asyncio.gather(*calls, return_exceptions=True)
    assert [type(each) for each in errors[:5]] == [taskrpc.OutcomeUnknown] * 5
    assert [type(each) for each in errors[5:]] == [taskrpc.ServiceUnavailable] * 5
    assert sorted(gate.cancelled) == [0, 1, 2, 3, 4]
    assert {each.not_executed for each in errors[5:]} == {True}


async def test_drain_finishes_calls_in_flight_and_moves_later_ones_to_another_server(net):
    first, second = await net.node("first"), await net.node("second")
    places = []

    def offer(node, name):
        async def where(request, response):
            places.append((name, request.a))
            await asyncio.sleep(0.002)
            response.sum = request.a
            return response

        node.create_service(Add, "where", where, concurrency=3, join=True)

    offer(first, "first")
    client = await net.client(Add, "where")
    assert await client.wait_for_service(60)
    offer(second, "second")
    calls = []

    async def load():
        for n in range(400):
            calls.append(client.call_async(ask(n)))
            await asyncio.sleep(0.0005)

    loading = asyncio.create_task(load())
    await until(lambda: len(places) > 50)
    await first.drain()
    await first.destroy()
    await loading
    assert [each.sum for each in await asyncio.gather(*calls)] == list(range(400))
    assert sorted(n for _, n in places) == list(range(400))  # each exactly once
    assert {name for name, _ in places} == {"first", "second"}


async def test_calls_that_wait_in_the_client_move_to_another_server_too(net):
    gate, other = Gate(), Gate()
    first, second = await net.node("first"), await net.node("second")
    first.create_service(Add, "gate", gate, concurrency=10_000)
    client = await net.client(Add, "gate")
    calls = [client.call_async(ask(n), timeout=None) for n in range(300)]
    await until(lambda: len(gate.started) == 256)
    second.create_service(Add, "gate", other, concurrency=10_000, join=True)
    await until_offered_by(client, 2)
    other.opened.set()
    draining = asyncio.create_task(first.drain())
    await asyncio.sleep(0.01)
    gate.opened.set()
    await draining
    assert [each.sum for each in await asyncio.gather(*calls)] == list(range(300))
    assert sorted(gate.started + other.started) == list(range(300))


async def test_a_moved_call_keeps_its_deadline_and_can_be_cancelled(net):
    gate, other = Gate(), Gate()
    first, second = await net.node("first"), await net.node("second")
    first.create_service(Add, "gate", gate)
    client = await net.client(Add, "gate")
    running = client.call_async(ask(0), timeout=None)
    await until(lambda: gate.started)
    # A middleware needs some time to show the second server.
    timeout = 0.3 if net.is_virtual else 2.0
    moved, cancelled = (client.call_async(ask(n), timeout=timeout) for n in (1, 2))
    await asyncio.sleep(0.01)
    second.create_service(Add, "gate", other, concurrency=5, join=True)
    await until_offered_by(client, 2)
    await first.destroy()
    assert isinstance(await outcome(running), taskrpc.OutcomeUnknown)
    await until(lambda: other.started == [1, 2])
    cancelled.cancel()
    await until(lambda: other.cancelled == [2])
    assert isinstance(await outcome(moved), taskrpc.DeadlineExceeded)


async def test_one_node_may_drain_while_its_neighbours_in_the_endpoint_go_on(net):
    one, other = await net.node("one", shared=True), await net.node("other", shared=True)
    gate = Gate()
    one.create_service(Add, "gate", gate)
    other.create_service(Add, "add", add)
    node = await net.node("caller")
    held = node.create_client(Add, "gate").call_async(ask(1), timeout=None)
    await until(lambda: gate.started)
    draining = asyncio.create_task(one.drain())
    await asyncio.sleep(0.02)
    assert (await node.create_client(Add, "add").call(ask(1, 2))).sum == 3
    assert not draining.done()
    gate.opened.set()
    await draining
    assert (await held).sum == 1


async def test_drain_gives_up_after_its_grace(net):
    server, client = await served(net, Gate())
    call = client.call_async(ask(), timeout=None)
    await asyncio.sleep(0.02)
    began = asyncio.get_running_loop().time()
    await server.drain(grace=0.1)
    assert 0.098 <= asyncio.get_running_loop().time() - began < 2
    await server.destroy()
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)


# Names


async def test_a_second_server_of_a_name_is_refused_until_it_joins(net):
    await served(net)
    second = await net.node("second")
    with pytest.raises(taskrpc.NameInUse, match="/add is already offered by"):
        second.create_service(Add, "add", add)
    second.create_service(Add, "add", add, join=True)


async def test_a_second_service_of_a_name_in_one_endpoint_is_refused(net):
    one, other = await net.node("one", shared=True), await net.node("other", shared=True)
    one.create_service(Add, "add", add)
    with pytest.raises(taskrpc.NameInUse, match="by the node /one of this process"):
        other.create_service(Add, "add", add)


async def test_many_clients_of_many_servers_are_all_answered(net):
    for n in range(3):
        server = await net.node(f"server{n}")
        server.create_service(Add, "add", add, join=True)
        server.create_service(Add, f"own{n}", add)
    clients = [await net.client(Add, name) for name in ("add", "own0", "own1", "own2") * 5]
    sums = await asyncio.gather(*[c.call_async(ask(n, n)) for c in clients for n in range(20)])
    assert [each.sum for each in sums] == [2 * n for n in range(20)] * 20


# Callbacks


async def test_current_call_names_the_caller_and_the_service(net):
    seen = []

    def look(request, response):
        call = taskrpc.current_call()
        seen.append((call.service, call.caller, call.number, call.cancelled))
        return response

    async def look_later(request, response):
        await asyncio.sleep(0)
        return look(request, response)

    _, client = await served(net, look)
    await client.call(ask())
    await client.call(ask())
    assert [each[:2] for each in seen] == [("/add", "/client")] * 2
    assert seen[0][2] + 1 == seen[1][2]
    for name, callback, threaded in (("later", look_later, False), ("thread", look, True)):
        _, client = await served(net, callback, name, threaded=threaded)
        await client.call(ask())
        assert seen[-1][0] == f"/{name}"
    with pytest.raises(LookupError, match="outside a service callback"):
        taskrpc.current_call()


async def test_a_callback_may_return_any_awaitable(net):
    node = await net.node()
    node.create_service(Add, "add", add)
    inner = node.create_client(Add, "add")
    node.create_service(Add, "call", lambda request, _: inner.call(request))
    node.create_service(Add, "future", lambda request, _: inner.call_async(request))
    for name in ("call", "future"):
        client = await net.client(Add, name)
        assert (await client.call(ask(1, 2))).sum == 3


async def test_a_callback_that_holds_the_loop_is_named_once(net, caplog, monkeypatch):
    loop = asyncio.get_running_loop()
    if not net.is_virtual:
        monkeypatch.setattr("taskrpc.service.HOLDS_LOOP_AFTER", 0.02)

    def hold(*_):
        loop.advance(0.26) if net.is_virtual else time.sleep(0.03)

    def plain(request, response):
        hold()
        return response

    async def suspending(request, response):
        await asyncio.sleep(0)
        hold()
        return response

    for name, callback in (("plain", plain), ("suspending", suspending)):
        caplog.clear()
        _, client = await served(net, callback, name)
        for _ in range(2):
            await client.call(ask())
        warned = [each for each in caplog.records if each.levelno == logging.WARNING]
        assert len(warned) == 1
        assert f"the callback of /{name} held the event loop for 0." in warned[0].message
        assert "threaded=True" in warned[0].message


async def test_a_callback_that_waits_is_not_blamed_for_the_time(net, caplog):
    async def waits(request, response):
        await asyncio.sleep(0.3)
        return response

    _, client = await served(net, waits)
    await client.call(ask())
    assert "held the event loop" not in caplog.text


# The graph


async def test_a_node_that_its_own_callback_destroys_leaves_the_graph(net):
    """The callback is cancelled with all others of its node; the node leaves all the same."""
    server = await net.node("server")
    watcher = await net.node("watcher")
    ended = asyncio.Event()

    async def leave(request, response):
        await asyncio.sleep(0)
        try:
            await server.destroy()
        finally:
            ended.set()
        return response

    server.create_service(Add, "leave", leave)
    client = await net.client(Add, "leave")
    place = server.address
    await until_seen(watcher, lambda entries: place in [each.address for each in entries])
    assert isinstance(await outcome(client.call(ask())), taskrpc.OutcomeUnknown)
    await ended.wait()
    await until_seen(watcher, lambda entries: place not in [each.address for each in entries])


async def test_the_graph_and_definitions_are_available(net):
    server, client = await served(net)
    node = await net.node("looker")
    entries = await node.graph()
    assert {name for entry in entries for name in entry.nodes} == {"/server", "/client", "/looker"}
    assert [e.type_name for entry in entries for e in entry.services] == [Add._TYPE]
    assert [e.node for entry in entries for e in entry.clients] == ["/client"]
    type_name, text = await node.definition("add")
    assert type_name == Add._TYPE
    assert "int64 a" in text
    with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /nobody"):
        await node.definition("nobody")
    assert isinstance(client, Client)
    await server.destroy()


async def test_each_node_of_one_program_is_known_by_its_own_name(net):
    callers = []

    def note(request, response):
        callers.append(taskrpc.current_call().caller)
        return response

    (await net.node()).create_service(Add, "note", note)
    one = await net.node("one", shared=True)
    two = await net.node("two", shared=True, namespace="robot")
    clients = [node.create_client(Add, "/note") for node in (one, two)]
    for client in [*clients, clients[0]]:
        await client.call(ask())
    assert callers == ["/one", "/robot/two", "/one"]


async def test_a_response_tells_how_long_the_call_was_in_the_server(net, monkeypatch):
    """RESPONSE's `arg`, in microseconds."""
    told = []
    monkeypatch.setattr(
        Session,
        "respond",
        lambda self, call_id, body, server_time=0, respond=Session.respond: (
            told.append(server_time),
            respond(self, call_id, body, server_time),
        ),
    )

    async def slow(request, response):
        await asyncio.sleep(0.05)
        return response

    (await net.node()).create_service(Add, "slow", slow)
    await (await net.client(Add, "slow")).call(ask())
    assert 45_000 <= told[-1] < 5_000_000  # uvloop counts in milliseconds


async def test_all_other_servers_of_the_name_that_is_called_run_a_request_too_and_no_others(net):
    ran = []

    def told(where):
        return lambda request, response: ran.append(where) or add(request, response)

    for where, name in (("one", "/ada/add"), ("two", "/ada/add"), ("the lab", "/add")):
        (await net.node("server")).create_service(Add, name, told(where), join=True)
    transport = (await net.node("client"))._transport
    channel = transport.channel("/ada/add", Add, "/client", otherwise=["/add"])
    assert await channel.wait(None)
    answers = []
    assert (await channel.send(ask(2, 3), None).future).sum == 5
    channel.send_to_others(ask(2, 3), answers.append)
    await until(lambda: answers)
    await asyncio.sleep(0.05)
    assert sorted(ran) == ["one", "two"]
    assert [each.sum for each in answers] == [5]
