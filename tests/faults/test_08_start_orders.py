"""Promise 8: a call of an unknown service fails at once; a waiting client is woken and does not
poll; no response is lost in any order in which programs start."""

import asyncio
import contextlib
import random

import pytest

import taskrpc
from taskrpc.core.transport import channel
from taskrpc.core.transport.discovery.availability import Availability
from taskrpc.core.transport.memory import MemoryNetwork
from taskrpc.core.transport.pipe import Pipe
from tests.core.transport.helpers import Add, add, ask, outcome
from tests.faults.harness import Bug, Lateness, milliseconds

pytestmark = pytest.mark.faults


def hears_no_news(patch):
    async def deaf(news, mark, timeout):
        await asyncio.sleep(1000 if timeout is None else timeout)
        return False

    patch(Availability, "wait", deaf)


def asks_again_and_again(patch):
    async def impatient(channel, failures, left):
        await asyncio.sleep(0.5)
        return 0

    patch(channel.RemoteChannel, "_wait_for_change", impatient)


def waits_for_what_nobody_offers(patch):
    connect = channel.RemoteChannel.connect

    async def patient(channel, deadline):
        await asyncio.sleep(1)
        await connect(channel, deadline)

    patch(channel.RemoteChannel, "connect", patient)


@pytest.mark.planted(Bug(waits_for_what_nobody_offers, "not at once"))
async def test_call_of_a_missing_service_fails_at_once(counts, seed):
    clock = asyncio.get_running_loop().time
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        for number in range(100):
            if number == 50:
                server.create_service(Add, "other", add)
            client = node.create_client(Add, f"unknown{number}")
            began = clock()
            try:
                await client.call(ask(number))
            except taskrpc.ServiceUnavailable as error:
                counts["refused"] += 1
                counts["wrong verdict"] += error.not_executed is not True
            counts["not at once"] += clock() > began
    counts.check("not at once", "wrong verdict", happened=("refused",))


@pytest.mark.real_time
@pytest.mark.planted(Bug(waits_for_what_nobody_offers, "not at once"))
async def test_call_of_a_missing_service_fails_at_once_on_sockets(counts, bug):
    async with (
        taskrpc.Node("server", token="s") as server,
        taskrpc.Node("here", token="h") as here,
    ):
        server.create_service(Add, "other", add)
        async with taskrpc.Node("client", peers=[server.address]) as asking:
            lateness, clock = Lateness(), asyncio.get_running_loop().time
            for number in range(100 if bug is None else 3):
                for node in (here, asking):  # looks into the registry; asks the peer itself
                    client = node.create_client(Add, f"unknown{number}")
                    began = clock()
                    error = await outcome(client.call(ask(number)))
                    took = clock() - began
                    counts["wrong verdict"] += type(error) is not taskrpc.ServiceUnavailable
                    counts["refused"] += 1
                    counts["most ms"] = max(counts["most ms"], milliseconds(took))
                    counts["not at once"] += took > 0.2 + 2 * lateness.longest
            lateness.stop()
    counts.check("not at once", "wrong verdict", happened=("refused",))


@pytest.mark.planted(Bug(asks_again_and_again, "looked again"))
async def test_waiting_for_an_hour_does_not_poll(counts, monkeypatch):
    def counted(owner, name, what):
        method = getattr(owner, name)

        def noted(*arguments):
            counts[what] += 1
            return method(*arguments)

        monkeypatch.setattr(owner, name, noted)

    async with taskrpc.Node("client", transport="memory") as node:
        client = node.create_client(Add, "add")
        counted(MemoryNetwork, "locate", "looks")
        counted(MemoryNetwork, "dial", "dials")
        counted(Pipe, "write", "writes")
        assert not await client.wait_for_service(3600)
    counts["looked again"] = max(0, counts["looks"] - 2)
    counts.check("looked again", "dials", "writes", happened=("looks",))


async def one_order(chance, counts, span, patience=10.0, **options):
    """Two servers and three clients start in any order; each client calls both services."""

    async def serve(stack, name):
        await asyncio.sleep(chance.uniform(0, span))
        node = await stack.enter_async_context(taskrpc.Node(name, token=name, **options))
        node.create_service(Add, name, add)
        await asyncio.sleep(chance.uniform(0, span))

    async def ask_both(stack, name):
        await asyncio.sleep(chance.uniform(0, span))
        node = await stack.enter_async_context(taskrpc.Node(name, token=name, **options))
        for service in chance.sample(["one", "two"], 2):
            client = node.create_client(Add, service)
            counts["waited for a server that was not there"] += not client.service_is_ready()
            if not await client.wait_for_service(patience):
                continue
            answer = await outcome(client.call(ask(1, 2)))
            counts["replies"] += getattr(answer, "sum", None) == 3

    async with contextlib.AsyncExitStack() as stack:
        await asyncio.gather(
            *[serve(stack, name) for name in ("one", "two")],
            *[ask_both(stack, name) for name in ("a", "b", "c")],
        )
    counts["orders"] += 1


@pytest.mark.planted(Bug(hears_no_news, "lost replies"))
async def test_no_response_is_lost_in_any_start_order_in_memory(counts, seed, large):
    for number in range(1000 if large else 100):
        chance = random.Random(f"{seed} {number}")
        await one_order(chance, counts, chance.choice([0, 0.001, 1]), transport="memory")
    counts["lost replies"] = 6 * counts["orders"] - counts["replies"]
    counts.check("lost replies", happened=("replies", "waited for a server that was not there"))


@pytest.mark.real_time
@pytest.mark.planted(Bug(hears_no_news, "lost replies"))
async def test_no_response_is_lost_in_any_start_order_on_sockets(counts, seed, large, bug):
    for number in range(1000 if large else 100 if bug is None else 10):
        chance = random.Random(f"{seed} {number}")
        span = chance.choice([0, 0.001, 0.02]) if bug is None else 0.02
        await one_order(chance, counts, span, 10.0 if bug is None else 0.3)
    counts["lost replies"] = 6 * counts["orders"] - counts["replies"]
    counts.check("lost replies", happened=("replies", "waited for a server that was not there"))
