"""Promise 11: clients reconnect to a restarted server, not in step, and lose nothing."""

import asyncio
import collections
import contextlib
import os
import random

import pytest

import taskrpc
from taskrpc.core.attempts import Attempts
from taskrpc.core.transport import channel
from taskrpc.core.transport.connection.client_side import CallingConnection
from taskrpc.core.transport.memory import MemoryNetwork
from tests.core.transport.helpers import Add, add, ask, until
from tests.faults.harness import Bug
from tests.faults.programs import ADDER, kill

pytestmark = pytest.mark.faults

CLIENTS = 16


def gives_up_at_once(patch):
    patch(Attempts, "_may_repeat", lambda self, error: False)


def comes_back_in_step(patch):
    patch(channel, "reconnect_delay", lambda failures, chance: min(5.0, 0.05 * 1.6**failures))


def comes_back_without_a_pause(patch):
    patch(channel, "reconnect_delay", lambda failures, chance: 0.02 * chance)


@contextlib.asynccontextmanager
async def crowd(**options):
    async with contextlib.AsyncExitStack() as stack:
        clients = []
        for number in range(CLIENTS):
            node = taskrpc.Node("client", token=f"c{number}", **options)
            await stack.enter_async_context(node)
            clients.append(node.create_client(Add, "add", timeout=30, retry=taskrpc.RetryPolicy()))
        yield clients


@pytest.mark.real_time
@pytest.mark.skipif(os.name != "posix", reason="kills with SIGKILL, which is POSIX's")
@pytest.mark.planted(Bug(gives_up_at_once, "lost"))
async def test_sixteen_clients_lose_nothing_while_their_server_is_killed_repeatedly(
    counts, seed, large, programs, monkeypatch
):
    chance = random.Random(seed)
    over = asyncio.Event()
    opened = CallingConnection._opened

    def noted(connection, event):
        counts["connections"] += 1
        opened(connection, event)

    handlers = {
        kind: noted if handler is opened else handler
        for kind, handler in CallingConnection.handlers.items()
    }
    monkeypatch.setattr(CallingConnection, "handlers", handlers)

    async def keep_calling(client, number):
        while not over.is_set():
            number += CLIENTS
            try:
                answer = await client.call(ask(number, 2))
                counts["wrong answers"] += answer.sum != number
                counts["answers"] += 1
            except taskrpc.TaskRpcError:
                counts["lost"] += 1
            await asyncio.sleep(0.005)

    async with crowd() as clients:
        server = await programs.start(ADDER, "idempotent")
        numbered = zip(clients, range(CLIENTS), strict=True)
        calling = [asyncio.ensure_future(keep_calling(*each)) for each in numbered]
        for _ in range(1000 if large else 15):
            await asyncio.sleep(chance.uniform(0.05, 0.2))
            await kill(server)
            counts["restarts"] += 1
            enough = counts["connections"] + CLIENTS // 2
            server = await programs.start(ADDER, "idempotent")
            # On a busy machine, the server would be killed before any client has come back.
            await until(lambda enough=enough: counts["lost"] or counts["connections"] >= enough)
            if counts["lost"]:
                break
        over.set()
        await asyncio.gather(*calling)
    counts["retries"] = sum(client.retries for client in clients)
    counts.check("lost", "wrong answers", happened=("restarts", "answers", "retries"))


@pytest.mark.planted(
    Bug(comes_back_in_step, "in step"), Bug(comes_back_without_a_pause, "dials too many")
)
async def test_clients_without_a_server_do_not_retry_in_step(counts, monkeypatch):
    # Each client dials less and less often; from the tenth time on about every four seconds.
    allowed = CLIENTS * 40
    loop = asyncio.get_running_loop()
    instants = collections.Counter()
    dial = MemoryNetwork.dial

    async def noted(network, address, factory):
        counts["dials"] += 1
        instants[round(loop.time(), 3)] += 1
        return await dial(network, address, factory)

    monkeypatch.setattr(MemoryNetwork, "dial", noted)
    async with (
        crowd(transport="memory") as clients,
        taskrpc.Node("server", transport="memory", token="s") as server,
    ):
        server.create_service(Add, "add", add)
        hub = clients[0]._channel._endpoint.network._hub
        # It is known and does not answer, like a machine that restarts.
        listeners, hub.listeners = hub.listeners, {}
        waiting = [asyncio.ensure_future(client.wait_for_service(600)) for client in clients]
        for _ in range(60):
            await asyncio.sleep(1)
            if counts["dials"] > 2 * allowed:
                break
        hub.listeners = listeners
        counts["did not come back"] = CLIENTS - sum(await asyncio.gather(*waiting))
    first = instants[0.0]
    counts["most at one instant"] = max(count for at, count in instants.items() if at > 1)
    counts["in step"] = counts["most at one instant"] > CLIENTS / 4
    counts["dials too many"] = max(0, counts["dials"] - allowed)
    assert first >= CLIENTS
    counts.check("in step", "dials too many", "did not come back", happened=("dials",))
