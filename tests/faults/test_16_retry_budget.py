"""Promise 16: retries do not amplify an outage."""

import asyncio

import pytest

import taskrpc
from taskrpc.retry import RetryBudget
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug

pytestmark = pytest.mark.faults

CALLERS = 20
EVERY = 0.25  # seconds between two calls of one caller
BURST = 10  # retries that a full budget allows at once


class Outage:
    """A service that fails every call with a retryable error, and then recovers."""

    def __init__(self, counts):
        self.counts = counts
        self.fails = True

    def work(self, request, response):
        self.counts["attempts"] += 1
        if self.fails:
            self.counts["failed attempts"] += 1
            raise taskrpc.HandlerError("UNAVAILABLE", "out of order")
        response.sum = request.a
        return response

    async def caller(self, client, until):
        loop = asyncio.get_running_loop()
        calls = []
        while loop.time() < until:
            calls.append(asyncio.ensure_future(self.call(client)))
            await asyncio.sleep(EVERY)
        await asyncio.wait(calls)

    async def call(self, client):
        self.counts["calls"] += 1
        try:
            await client.call(ask(1))
            self.counts["answered"] += 1
        except taskrpc.TaskRpcError:
            self.counts["failed"] += 1


def the_budget_is_endless(patch):
    patch(RetryBudget, "book", lambda self, now, wait, latest: wait)


def the_floor_is_high(patch):
    patch(taskrpc.retry, "_BUDGET_FLOOR", 30.0)


@pytest.mark.planted(
    Bug(the_budget_is_endless, "attempts too many"), Bug(the_floor_is_high, "attempts too many")
)
async def test_retries_add_few_requests_during_an_outage_of_a_minute(counts, large):
    seconds = 3600 if large else 60
    outage, loop = Outage(counts), asyncio.get_running_loop()
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "work", outage.work)
        policy = taskrpc.RetryPolicy()
        client = node.create_client(Add, "work", timeout=5, retry=policy)
        await client.wait_for_service()
        began = loop.time()
        await asyncio.gather(*[outage.caller(client, began + seconds) for _ in range(CALLERS)])
        lasted = loop.time() - began
        allowed = 1.10 * counts["calls"] + 3 * lasted + BURST
        counts["retries"] = counts["attempts"] - counts["calls"]
        counts["attempts too many"] = max(0, round(counts["attempts"] - allowed))
        outage.fails = False
        await asyncio.gather(*[outage.call(client) for _ in range(100)])
        counts["not well again"] = 100 - counts["answered"]
    counts.check("attempts too many", "not well again", happened=("retries", "failed attempts"))
    counts.require(calls=4000, retries=100)
