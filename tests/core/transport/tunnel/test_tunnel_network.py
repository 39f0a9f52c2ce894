"""Connections over an engine end cleanly, whatever happens to programs and datagrams."""

import asyncio
import collections
import random

import msgspec
import pytest

import taskrpc
from taskrpc.core.transport.limits.admission import MAX_UNAUTHENTICATED
from taskrpc.core.transport.tunnel import frames
from taskrpc.core.transport.tunnel.frames import Kind
from taskrpc.core.transport.tunnel.tunnel_network import PUBLIC_TOKEN
from tests.core.transport.helpers import Add, Gate, Text, add, ask, outcome, until, until_seen


async def served(programs, callback=add, **settings):
    server, node = await programs.node("server"), await programs.node("client")
    server.create_service(Add, "add", callback, **settings)
    client = node.create_client(Add, "add")
    assert await client.wait_for_service(60)
    return server, node, client


# Faults of the middleware


async def test_a_lost_datagram_ends_the_connection_and_the_next_call_makes_another(programs):
    _, _, client = await served(programs)
    programs.bus.faults = lambda place, datagram: []
    lost = client.call_async(ask(1), timeout=None)
    await asyncio.sleep(0.1)
    programs.bus.faults = None
    later = await outcome(client.call(ask(2)))
    assert isinstance(later, taskrpc.OutcomeUnknown)
    assert isinstance(await outcome(lost), taskrpc.OutcomeUnknown)
    assert (await client.call(ask(3))).sum == 3


async def test_a_lost_response_is_noticed_at_the_latest_when_the_client_probes(programs):
    """The first probe of a silent connection shows the gap."""
    _, _, client = await served(programs)
    gate = client._channel._connection
    call = client.call_async(ask(1), timeout=None)
    programs.bus.faults = lambda place, datagram: []
    await asyncio.sleep(1)
    programs.bus.faults = None
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
    assert client._channel._connection is not gate or not client._channel.ready


async def test_repeated_datagrams_change_nothing(programs):
    programs.bus.faults = lambda place, datagram: [datagram] * 3
    server, _, client = await served(programs)
    for number in range(100):
        assert (await client.call(ask(number))).sum == number
    assert len(server._transport._served) == 1


@pytest.mark.parametrize("seed", range(30))
async def test_calls_run_at_most_once_and_their_outcome_is_known(programs, seed):
    """Datagrams are lost, repeated and overtake each other."""
    chance = random.Random(seed)
    runs = collections.Counter()
    loop = asyncio.get_running_loop()

    def count(request, response):
        runs[request.a] += 1
        response.sum = request.a
        return response

    _, _, client = await served(programs, count)

    def faults(place, datagram):
        fate = chance.random()
        if fate < 0.02:
            return []
        if fate < 0.04:
            return [datagram, datagram]
        if fate < 0.05:
            loop.call_soon(loop.call_soon, receive, place, datagram)
            return []
        return [datagram]

    def receive(place, datagram):
        if (engine := programs.bus.engines.get(place)) is not None:
            engine.events.received(datagram)

    programs.bus.faults = faults
    results = {}
    for number in range(200):
        results[number] = await outcome(client.call(ask(number), timeout=2))
    programs.bus.faults = None
    for number, result in results.items():
        if isinstance(result, taskrpc.TaskRpcError):
            assert runs[number] <= 1
            assert not (result.not_executed and runs[number])
        else:
            assert (result.sum, runs[number]) == (number, 1)
    assert any(isinstance(each, taskrpc.TaskRpcError) for each in results.values())
    assert (await client.call(ask(1000), retry=taskrpc.RetryPolicy(), timeout=60)).sum == 1000


async def test_a_lost_request_for_a_connection_ends_in_service_unavailable(programs):
    server, node = await programs.node("server"), await programs.node("client")
    server.create_service(Add, "add", add)
    programs.bus.faults = lambda place, datagram: []
    client = node.create_client(Add, "add")
    await until_seen(node, lambda entries: any(each.offers("/add") for each in entries))
    with pytest.raises(taskrpc.ServiceUnavailable, match="did not respond"):
        await client.call(ask())
    programs.bus.faults = None
    assert (await client.call(ask(1))).sum == 1


async def test_garbage_disturbs_no_connection(programs):
    server, node, client = await served(programs)
    chance = random.Random(5)
    loop = asyncio.get_running_loop()
    streams = server._transport.network._table.streams
    ids = [*streams, *node._transport.network._table.streams]
    loop.set_exception_handler(lambda loop, context: pytest.fail(str(context)))
    for number in range(300):
        for each in programs.bus.engines.values():
            each.events.received(chance.randbytes(chance.randrange(100)))
            kind = chance.choice([*Kind])
            wrong = chance.getrandbits(64)
            each.events.received(frames.pack(kind, wrong, 0, 9) + chance.randbytes(30))
            # Not even one that knows the id can break the protocol of another connection.
            each.events.received(frames.pack(Kind.ACK, chance.choice(ids)) + chance.randbytes(8))
        assert (await client.call(ask(number))).sum == number
    assert len(server._transport._served) == 1


@pytest.mark.faults
async def test_a_flood_of_requests_for_connections_takes_bounded_memory(programs):
    server, _, client = await served(programs)
    network = server._transport.network
    for number in range(10_000):
        network.received(frames.pack_syn(number + 1, f"place {number % 50}", 1000))
        if not number % 100:
            await asyncio.sleep(0)
    assert len(network._table.streams) <= MAX_UNAUTHENTICATED + 110
    assert len(network._table.accepted) == len(network._table.streams)
    assert (await client.call(ask(1))).sum == 1
    await asyncio.sleep(10)
    assert len(network._table.streams) == len(network._table.accepted) == 1
    assert len(network._table.forgotten) <= 1024


async def test_an_error_in_one_connection_does_not_disturb_another(programs, monkeypatch):
    server, _, client = await served(programs)
    other = (await programs.node("other")).create_client(Add, "add")
    await other.wait_for_service(60)
    problems = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: problems.append(context))
    first = next(iter(server._transport._served))

    class Broken(Exception):
        pass

    def fail(nbytes):
        raise Broken

    monkeypatch.setattr(first.transport, "_protocol", first)
    monkeypatch.setattr(type(first), "buffer_updated", lambda self, n: fail(n))
    lost = await outcome(client.call(ask(1)))
    monkeypatch.undo()
    assert isinstance(lost, taskrpc.OutcomeUnknown)
    assert [type(each["exception"]) for each in problems] == [Broken]
    assert (await other.call(ask(2))).sum == 2
    assert (await client.call(ask(3), retry=taskrpc.RetryPolicy())).sum == 3


# Programs that come and go


async def test_calls_to_a_program_that_vanishes_end_at_once(programs):
    gate = Gate()
    server, _, client = await served(programs, gate)
    call = client.call_async(ask(1), timeout=None)
    await until(lambda: gate.started)
    began = asyncio.get_running_loop().time()
    programs.vanish(server)
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
    with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /add"):
        await client.call(ask(2))
    assert asyncio.get_running_loop().time() == pytest.approx(began, abs=0.05)


async def test_dialling_a_program_that_vanishes_ends_at_once(programs):
    server, node = await programs.node("server"), await programs.node("client")
    server.create_service(Add, "add", add)
    client = node.create_client(Add, "add")
    await until_seen(node, lambda entries: any(each.offers("/add") for each in entries))
    programs.bus.faults = lambda place, datagram: []
    call = asyncio.ensure_future(client.call(ask()))
    await asyncio.sleep(0.01)
    programs.vanish(server)
    began = asyncio.get_running_loop().time()
    assert isinstance(await outcome(call), taskrpc.ServiceUnavailable)
    assert asyncio.get_running_loop().time() < began + 0.1


async def test_a_missed_end_of_a_connection_is_told_again(programs):
    server, _, client = await served(programs)
    (serving,) = server._transport._served
    programs.bus.faults = lambda place, datagram: []
    serving.transport.abort()
    await asyncio.sleep(0.1)
    programs.bus.faults = None
    assert not server._transport._served
    assert isinstance(await outcome(client.call(ask(1), timeout=None)), taskrpc.OutcomeUnknown)
    assert (await client.call(ask(2))).sum == 2


async def test_an_interruption_ends_all_calls_and_later_all_goes_on(programs, caplog):
    gate = Gate()
    server, node, client = await served(programs, gate, concurrency=2)
    call = client.call_async(ask(1), timeout=None)
    await until(lambda: gate.started)
    programs.bus.faults = lambda place, datagram: []
    networks = [each._transport.network for each in (server, node)]
    for network in networks:
        network.interrupted("the router at tcp/localhost:7447 is gone")
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
    with pytest.raises(
        taskrpc.ServiceUnavailable, match="the router at tcp/localhost:7447 is gone"
    ):
        await client.call(ask(2))
    waiting = asyncio.ensure_future(client.wait_for_service(60))
    await asyncio.sleep(1)
    assert not waiting.done()
    programs.bus.faults = None
    for network in networks:
        network.resumed()
    for one in programs.bus.engines.values():
        for other in programs.bus.others(one):
            one.program_seen(other.address, other.announced)
    assert await waiting
    gate.opened.set()
    assert (await client.call(ask(3))).sum == 3
    assert "is interrupted: the router at" in caplog.text


async def test_hours_of_calls_leave_nothing_behind(programs):
    server, node, client = await served(programs)
    for number in range(4):
        assert (await client.call(ask(number))).sum == number
        await asyncio.sleep(3600)
    assert len(server._transport.network._table.streams) == 1
    assert len(node._transport.network._table.streams) == 1


async def test_closed_connections_are_forgotten(programs):
    server, _, client = await served(programs)
    async with taskrpc.Node("brief", transport="tunnel", listen="brief") as brief:
        other = brief.create_client(Add, "add")
        assert await other.wait_for_service(60)
        network = brief._transport.network
    assert (network._table.streams, network._table.accepted, network._table.dialling) == (
        {},
        {},
        {},
    )
    await until(lambda: len(server._transport.network._table.streams) == 1)
    assert (await client.call(ask(1))).sum == 1


# Presence


async def test_a_second_server_of_a_name_is_refused_with_advice(programs):
    _, node, _ = await served(programs)
    with pytest.raises(taskrpc.NameInUse, match="/add is already offered by the node /server of"):
        node.create_service(Add, "add", add)
    node.create_service(Add, "add", add, join=True)


async def test_an_announcement_has_no_secret_and_nothing_of_this_machine(programs):
    one = await programs.node("one", token="the secret")
    one.create_service(Add, "one", add)
    other = await programs.node("other")
    other.create_service(Add, "other", add)
    await asyncio.sleep(0.01)
    looking = await programs.node("looking")
    for entry in await looking.graph():
        if "/looking" not in entry.nodes:
            assert (entry.pid, entry.folder) == (0, "")
            assert bytes.fromhex(entry.token) in (b"", PUBLIC_TOKEN)
    announced = [each.announced or b"" for each in programs.bus.engines.values()]
    assert not any(b"the secret" in each for each in announced)
    assert not any(b"the secret".hex().encode() in each for each in announced)


async def test_nodes_of_one_program_call_each_other_without_the_middleware(programs):
    programs.bus.faults = lambda place, datagram: pytest.fail("a datagram was sent")
    node = await programs.node("node")
    node.create_service(Add, "add", add)
    client = node.create_client(Add, "add")
    assert (await client.call(ask(1, 2))).sum == 3
    node._transport.network.interrupted("the router is gone")
    assert (await client.call(ask(1, 2))).sum == 3


async def test_a_program_with_a_secret_calls_one_without(programs):
    server = await programs.node("server")
    server.create_service(Add, "add", add)
    account = taskrpc.Account("ana", "anas-secret-anas")
    for token in ("the secret", account.token):
        node = await programs.node(f"node{len(token)}", token=token)
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(60)
        assert (await client.call(ask(1, 2))).sum == 3


async def test_a_program_that_comes_changes_or_goes_is_a_change(programs):
    node = await programs.node("node")
    network = node._transport.network
    await asyncio.sleep(0.1)
    mark = network.mark()
    async with taskrpc.Node("other", transport="tunnel", listen="other") as other:
        await network.changed(mark, bool)
        await asyncio.sleep(0.1)
        mark = network.mark()
        other.create_service(Add, "add", add)
        await network.changed(mark, bool)
        await asyncio.sleep(0.1)
        mark = network.mark()
        await asyncio.sleep(60)
        assert network.mark() == mark
    await network.changed(mark, bool)


async def test_a_program_does_not_see_itself_twice(programs):
    node = await programs.node("node")
    network = node._transport.network
    await asyncio.sleep(0.1)
    network.program_seen(node.address or network._engine.address, network._engine.announced)
    assert [each.nodes for each in await node.graph()] == [("/node",)]


async def test_a_program_announces_itself_again_after_an_interruption(programs, monkeypatch):
    node = await programs.node("node")
    network, announced = node._transport.network, []
    await asyncio.sleep(0.1)
    monkeypatch.setattr(network._engine, "announce", announced.append)
    network.interrupted("the router is gone")
    network.resumed()
    (again,) = map(msgspec.msgpack.decode, announced)
    *first, revision = msgspec.msgpack.decode(network._engine.announced)
    assert again == [*first, revision + 1]


async def test_an_invalid_announcement_is_ignored(programs, caplog):
    _, node, client = await served(programs)
    for garbage in (b"", b"\xc1", b"\x80", bytes(100)):
        node._transport.network.program_seen("elsewhere", garbage)
    assert all("elsewhere" not in each.address for each in await node.graph())
    assert "ignored the program at elsewhere: Presence is not valid" in caplog.text
    assert (await client.call(ask(1))).sum == 1


async def test_thousands_of_services_are_announced_once_in_a_turn(programs, monkeypatch):
    server, node = await programs.node("server"), await programs.node("client")
    engine, count = server._transport.network._engine, 0
    announce = engine.announce

    def counted(entry):
        nonlocal count
        count += 1
        announce(entry)

    monkeypatch.setattr(engine, "announce", counted)
    for number in range(2000):
        server.create_service(Add, f"add{number}", add)
    client = node.create_client(Add, "add1999")
    assert await client.wait_for_service(60)
    assert count == 1


# Flow control


async def test_a_program_that_does_not_read_keeps_at_most_a_window_of_bytes(programs):
    server, node = await programs.node("server"), await programs.node("client")
    server.create_service(Text, "sink", lambda request, response: response)
    client = node.create_client(Text, "sink")
    assert await client.wait_for_service(60)
    (serving,) = server._transport._served
    serving.transport.pause_reading()
    request = Text.Request(task_type="x" * 100_000)
    calls = [client.call_async(request, timeout=None) for _ in range(100)]
    await asyncio.sleep(1)
    assert 900_000 < serving.transport._inbox_size <= 1024 * 1024
    serving.transport.resume_reading()
    assert len(await asyncio.gather(*calls)) == 100
