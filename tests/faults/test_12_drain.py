"""Promise 12: SIGTERM drains: calls in flight are answered, later ones move to another server."""

import asyncio
import contextlib
import os
import random

import pytest

import taskrpc
from taskrpc.node import Node
from tests.faults.harness import Bug
from tests.faults.programs import ADDER, terminate
from tests.taskrpc.transport.helpers import Add, ask

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(os.name != "posix", reason="ends servers with SIGTERM, which is POSIX's"),
]

CLIENTS, AT_ONCE = 8, 6


def does_not_drain(patch):
    async def hurried(node, grace=0.0):
        pass

    patch(Node, "drain", hurried)


@pytest.mark.planted(Bug(does_not_drain, "errors that callers saw"))
async def test_no_caller_sees_that_servers_are_told_to_end(counts, seed, large, programs):
    chance = random.Random(seed)
    over = asyncio.Event()
    in_flight = 0

    async def keep_calling(client, number):
        nonlocal in_flight
        while not over.is_set():
            number += 1
            in_flight += 1
            try:
                # No retries: what is moved was never begun, and whoever has begun answers.
                answer = await client.call(ask(number, chance.randrange(40)))
                counts["wrong answers"] += answer.sum != number
                counts["answers"] += 1
            except taskrpc.TaskRpcError:
                counts["errors that callers saw"] += 1
            in_flight -= 1
            await asyncio.sleep(0.005)

    async with contextlib.AsyncExitStack() as stack:
        old = await programs.start(ADDER, "join")
        clients = []
        for number in range(CLIENTS):
            node = taskrpc.Node("client", token=f"c{number}")
            await stack.enter_async_context(node)
            clients.append(node.create_client(Add, "add"))
            assert await clients[-1].wait_for_service(10)
        calling = [
            asyncio.ensure_future(keep_calling(client, 1000 * number))
            for client in clients
            for number in range(AT_ONCE)
        ]
        for _ in range(1000 if large else 30):
            new = await programs.start(ADDER, "join")
            counts["in flight at a SIGTERM"] += in_flight
            counts["ended badly"] += await terminate(old) != 0
            counts["SIGTERMs"] += 1
            old = new
            if counts["errors that callers saw"]:
                break
        over.set()
        await asyncio.gather(*calling)
    counts.check(
        "errors that callers saw",
        "wrong answers",
        "ended badly",
        happened=("SIGTERMs", "answers", "in flight at a SIGTERM"),
    )
