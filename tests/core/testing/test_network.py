"""A faulty network applies its settings to its own connections and to no others."""

import asyncio

import pytest

import taskrpc
from taskrpc.testing import FaultyNetwork
from tests.core.transport.helpers import Add, add, ask, outcome


async def test_without_settings_nothing_is_different(lab):
    network, client = lab
    assert (await client.call(ask(2, 3))).sum == 5
    assert network.happened == {"connections": 1}


@pytest.mark.parametrize("lab", [{"refuse": 1.0}], indirect=True)
async def test_refused_connection_is_reported_at_once(lab):
    network, client = lab
    with pytest.raises(taskrpc.ServiceUnavailable, match="refused"):
        await client.call(ask())
    assert network.happened["refusals"]


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
