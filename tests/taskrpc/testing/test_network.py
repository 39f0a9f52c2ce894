"""A faulty network applies its settings to its own connections and to no others."""

import asyncio

import pytest

import taskrpc
from taskrpc.testing import FaultyNetwork
from tests.taskrpc.transport.helpers import Add, add, ask, outcome


@pytest.fixture
async def lab(request):
    """A server and a client on a network with the settings of the test's parameter."""
    server = taskrpc.Node("server", transport="memory", listen="server")
    user = taskrpc.Node("user", transport="memory", listen="user")
    with FaultyNetwork(seed=3, **getattr(request, "param", {})) as network:
        async with server, user:
            server.create_service(Add, "add", add)
            client = user.create_client(Add, "add", timeout=5)
            yield network, client


async def test_without_settings_nothing_is_different(lab):
    network, client = lab
    assert (await client.call(ask(2, 3))).sum == 5
    assert network.happened == {"connections": 1}


@pytest.mark.parametrize("lab", [{"delay": (0.1, 0.1)}], indirect=True)
async def test_delay_applies_in_both_directions(lab):
    _, client = lab
    await client.call(ask())
    began = asyncio.get_running_loop().time()
    await client.call(ask())
    assert asyncio.get_running_loop().time() - began == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("lab", [{"pieces": 3, "delay": (0.0, 0.01)}], indirect=True)
async def test_calls_survive_being_cut_into_pieces(lab):
    _, client = lab
    answers = await asyncio.gather(*(client.call(ask(number, 1)) for number in range(20)))
    assert [answer.sum for answer in answers] == list(range(1, 21))


@pytest.mark.parametrize("lab", [{"cut_after": 1000}], indirect=True)
async def test_connections_are_cut_at_any_byte_and_made_again(lab):
    network, client = lab
    answers = [await outcome(client.call(ask(number))) for number in range(100)]
    assert network.happened["cuts"] > 3
    assert network.happened["connections"] > 3
    lost = [each for each in answers if isinstance(each, taskrpc.TaskRpcError)]
    assert all(
        isinstance(each, taskrpc.ConnectionLost | taskrpc.ServiceUnavailable) for each in lost
    )
    assert 0 < len(lost) < 90


@pytest.mark.parametrize("lab", [{"refuse": 1.0}], indirect=True)
async def test_refused_connection_is_reported_at_once(lab):
    network, client = lab
    with pytest.raises(taskrpc.ServiceUnavailable, match="refused"):
        await client.call(ask())
    assert network.happened["refusals"]


@pytest.mark.parametrize("ways", [("user", "server"), ("server", "user")])
async def test_connection_with_one_silent_direction_dies_for_the_sender(lab, ways):
    network, client = lab
    await client.call(ask())
    network.partition(*ways, both=False)
    began = asyncio.get_running_loop().time()
    with pytest.raises(taskrpc.OutcomeUnknown):
        await client.call(ask(), timeout=60)
    assert 8 <= asyncio.get_running_loop().time() - began < 8.1


async def test_held_back_bytes_arrive_after_heal(lab):
    network, client = lab
    await client.call(ask())
    network.partition("user", "server")
    call = client.call_async(ask(1, 1))
    await asyncio.sleep(2)
    assert not call.done()
    network.heal()
    assert (await call).sum == 2
    assert not network.happened["deaths"]


async def test_connecting_through_silence_waits_for_its_end(lab):
    network, client = lab
    network.partition("user", "server")
    call = client.call_async(ask(1, 1))
    await asyncio.sleep(1)
    network.heal()
    assert (await call).sum == 2


async def test_a_killed_program_resets_its_connections_and_offers_nothing(lab):
    network, client = lab
    await client.call(ask())
    network.crash("server")
    with pytest.raises(taskrpc.TaskRpcError):
        await client.call(ask())
    assert not client.service_is_ready()


async def test_connections_made_before_or_elsewhere_are_left_alone():
    async with taskrpc.Node("both", transport="memory") as node:
        node.create_service(Add, "add", add)
        client = node.create_client(Add, "add")
        await client.call(ask())
        with FaultyNetwork(seed=3) as network:
            network.partition("", "")
            assert (await client.call(ask(1, 2))).sum == 3
            assert not network.happened


async def test_peer_of_a_killed_program_learns_of_an_earlier_cut():
    server = taskrpc.Node("server", transport="memory", listen="server")
    user = taskrpc.Node("user", transport="memory", listen="user")
    with FaultyNetwork(delay=(0.1, 0.1)) as network:
        async with user, server:
            server.create_service(Add, "slow", never)
            client = user.create_client(Add, "slow", timeout=60)
            call = asyncio.ensure_future(client.call(ask()))
            await asyncio.sleep(2)
            network.cut("user", "server")
            await asyncio.sleep(0.05)
            network.crash("server")
            await asyncio.sleep(1)
            assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
            assert asyncio.get_running_loop().time() < 4


async def never(request, response):
    await asyncio.get_running_loop().create_future()
