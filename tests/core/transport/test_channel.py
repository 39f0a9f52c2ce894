"""A client's channel notices every change of the server, whenever the change arrives."""

import asyncio

import pytest

import taskrpc
from taskrpc.core.wire.frames import FrameType, pack_frame
from taskrpc.testing import FaultyNetwork
from tests.core.transport.helpers import Add, Gate, Text, add, ask, outcome, until


async def test_change_that_arrives_with_the_answer_to_resolve_makes_the_client_resolve_again():
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "first", add)
        server.create_service(Add, "add", add)
        first = node.create_client(Add, "first")
        assert await first.wait_for_service(60)
        (serving,) = server._transport._served
        asking = first._channel._connection
        asked, answers = [], []
        write_request, write_answer = asking.transport.write, serving.transport.write

        def recorded(data):
            asked.append(data[4])
            write_request(data)

        def with_a_change(data):
            answers.append(data[4])
            if answers == [FrameType.RESPONSE]:
                data = bytes(data) + pack_frame(FrameType.ADVERTISE, 0, 0, 0, 0)
            write_answer(data)

        asking.transport.write, serving.transport.write = recorded, with_a_change
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(60)
        assert asked.count(FrameType.RESOLVE) == 2
        assert (await client.call(ask(1, 2))).sum == 3


async def test_known_server_that_cannot_be_reached_is_dialled_at_growing_intervals():
    with FaultyNetwork(seed=3) as network:
        async with (
            taskrpc.Node("s", transport="memory", listen="server") as server,
            taskrpc.Node("c", transport="memory", listen="client") as node,
        ):
            server.create_service(Add, "add", add)
            network.partition("client", "server")
            client = node.create_client(Add, "add")
            dials, dial = [], node._transport.network.dial
            loop = asyncio.get_running_loop()

            async def counted(*arguments):
                dials.append(loop.time())
                return await dial(*arguments)

            node._transport.network.dial = counted
            waiting = asyncio.ensure_future(client.wait_for_service(300))
            await asyncio.sleep(120)
            assert 3 <= len(dials) <= 60
            network.heal()
            healed = loop.time()
            assert await waiting
            assert loop.time() - healed < 20
            assert (await client.call(ask(1, 2))).sum == 3


async def test_server_that_appears_while_a_dead_one_is_dialled_is_tried_too():
    async with (
        taskrpc.Node("dead", transport="memory", listen="dead") as dead,
        taskrpc.Node("client", transport="memory", listen="client") as node,
        taskrpc.Node("alive", transport="memory", listen="alive") as alive,
    ):
        dead.create_service(Add, "add", add)
        client, dial = node.create_client(Add, "add"), node._transport.network.dial

        async def dialled(address, factory):
            if address.text != dead.address:
                return await dial(address, factory)
            alive.create_service(Add, "add", add, join=True)
            raise ConnectionRefusedError("the program has left")

        node._transport.network.dial = dialled
        assert (await client.call(ask(1, 2))).sum == 3


async def test_call_that_finds_no_other_server_fails_at_once():
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        gate = Gate()
        service = server.create_service(Add, "gate", gate)
        client = node.create_client(Add, "gate")
        assert await client.wait_for_service(60)
        running = client.call_async(ask(1), timeout=60)
        await until(lambda: gate.started)
        began = asyncio.get_running_loop().time()
        service.destroy()
        late = await outcome(client.call(ask(2), timeout=60))
        assert isinstance(late, taskrpc.ServiceUnavailable)
        assert late.not_executed
        assert asyncio.get_running_loop().time() - began < 1
        gate.opened.set()
        assert (await running).sum == 1


async def test_call_waits_for_a_server_while_the_network_discovers_programs():
    loop = asyncio.get_running_loop()
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        node._transport.network.discovery_ends = loop.time() + 5
        client = node.create_client(Add, "add")
        calling = client.call_async(ask(1, 2), timeout=10)
        await asyncio.sleep(2)
        server.create_service(Add, "add", add)
        assert (await calling).sum == 3


@pytest.mark.parametrize(("timeout", "waited"), [(1.0, 1.0), (20.0, 5.0), (None, 5.0)])
async def test_call_waits_no_longer_than_discovery_and_its_deadline(timeout, waited):
    loop = asyncio.get_running_loop()
    async with taskrpc.Node("client", transport="memory") as node:
        node._transport.network.discovery_ends = loop.time() + 5
        began = loop.time()
        with pytest.raises(taskrpc.ServiceUnavailable, match=r"^no server offers /add$") as caught:
            await node.create_client(Add, "add").call(ask(1), timeout=timeout)
        assert caught.value.not_executed
        assert loop.time() - began == pytest.approx(waited)


async def test_server_of_another_type_is_reported_once_while_a_client_waits(caplog):
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Text, "add", lambda request, response: response)
        client = node.create_client(Add, "add")
        waiting = asyncio.ensure_future(client.wait_for_service(60))
        for number in range(3):  # each of these is a reason to look again
            await asyncio.sleep(5)
            server.create_service(Add, f"other_{number}", add)
        assert not await waiting
        assert caplog.text.count("has another definition") == 1
        with pytest.raises(taskrpc.TypeMismatch):
            await client.call(ask(), timeout=1)


async def test_failures_to_reach_a_known_server_are_counted_until_something_changes(monkeypatch):
    counts = []

    def delay(failures, chance):
        assert 0.0 <= chance < 1.0
        counts.append(failures)
        return 1.0

    monkeypatch.setattr("taskrpc.core.transport.channel.reconnect_delay", delay)
    with FaultyNetwork(seed=3) as network:
        async with (
            taskrpc.Node("s", transport="memory", listen="server") as server,
            taskrpc.Node("c", transport="memory", listen="client") as node,
        ):
            server.create_service(Add, "add", add)
            network.partition("client", "server")
            client = node.create_client(Add, "add")
            waiting = asyncio.ensure_future(client.wait_for_service(300))
            await until(lambda: len(counts) >= 5, 100)
            assert counts == [0, 1, 2, 3, 4]
            server.create_service(Add, "other", add)
            await until(lambda: len(counts) >= 8, 100)
            assert 0 in counts[5:]
            network.heal()
            assert await waiting


async def test_request_for_other_servers_is_not_sent_without_other_servers():
    async with taskrpc.Node("client", transport="memory", token="c") as node:
        channel = node._transport.channel("/add", Add, "/client")
        answers = []
        sent = asyncio.wrap_future(channel.send_to_others(ask(1, 2), answers.append))
        assert await sent is None
        assert answers == []
        channel.close()
