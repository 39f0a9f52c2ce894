"""Connections that are cut, silent or slow."""

import asyncio

import pytest

import taskrpc
from tests.core.transport.helpers import ask, outcome


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
