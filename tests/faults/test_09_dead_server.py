"""Promise 9: when a server dies, its pending calls end quickly with an unknown outcome."""

import asyncio
import contextlib
import os
import time

import pytest

import taskrpc
from taskrpc.core.transport.connection import client_side
from taskrpc.core.transport.connection.client_side import CallingConnection
from taskrpc.core.wire.session import refused_error
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug, Lateness, milliseconds, percentile

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(os.name != "posix", reason="kills with SIGKILL, which is POSIX's"),
]

CLIENTS = 5


def tells_nobody(patch):
    def ended(connection):
        connection.epoch += 1

    patch(CallingConnection, "ended", ended)


def tells_late(patch):
    ended = CallingConnection.ended
    late = lambda connection: connection.owner.loop.call_later(1, ended, connection)  # noqa: E731
    patch(CallingConnection, "ended", late)


def says_that_nothing_ran(patch):
    patch(client_side, "unknown_error", refused_error)


@pytest.mark.planted(
    Bug(tells_nobody, "not told"),
    Bug(tells_late, "told late"),
    Bug(says_that_nothing_ran, "wrong verdict"),
)
async def test_1000_calls_in_flight_end_soon_after_their_server_died(counts, large, programs):
    for _ in range(20 if large else 3):
        late, loop_late = await _one_death(counts, programs)
        counts["kills"] += 1
        counts["p99 ms"] = max(counts["p99 ms"], milliseconds(percentile(late, 0.99)))
        counts["told late"] += percentile(late, 0.99) > 0.5 + 10 * loop_late
        counts["over 50 ms"] += percentile(late, 0.99) > 0.050 + 4 * loop_late
        if counts["not told"] or counts["told late"]:
            break
    counts.check("not told", "told late", "wrong verdict", happened=("kills", "told"))
    if large:
        counts.check("over 50 ms")


async def _one_death(counts, programs):
    """Kill a server with 1000 calls in flight; returns each caller's delay and the loop's."""
    server = await programs.start()
    heard = []
    async with contextlib.AsyncExitStack() as stack:
        clients = []
        for number in range(CLIENTS):
            node = taskrpc.Node("client", token=f"c{number}")
            await stack.enter_async_context(node)
            clients.append(node.create_client(Add, "add"))
            assert await clients[-1].wait_for_service(10)
        calls = [
            clients[n % CLIENTS].call_async(ask(n, 600_000), timeout=None) for n in range(1000)
        ]
        for call in calls:
            call.add_done_callback(lambda _: heard.append(time.monotonic()))
        for client in clients:  # sent after the others, so that those have arrived
            await client.call(ask(1))
        lateness = Lateness()
        began = time.monotonic()
        server.kill()
        _, silent = await asyncio.wait(calls, timeout=5)
        loop_late = lateness.stop()
        counts["not told"] += len(silent)
        counts["told"] += len(heard)
        for call in silent:
            call.cancel()
        errors = await asyncio.gather(*calls, return_exceptions=True)
        wrong = [each for each in errors if type(each) is not taskrpc.OutcomeUnknown]
        counts["wrong verdict"] += len(wrong) - len(silent)
    return [each - began for each in heard] or [5.0], loop_late
