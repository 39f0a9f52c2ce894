"""Promise 1: each call has a deadline, and ends never early and at most one tick late."""

import asyncio
import random
import time

import pytest

import taskrpc
from taskrpc.client import DEFAULT_TIMEOUT, Client
from taskrpc.core.transport.connection import deadline_timer
from taskrpc.core.transport.connection.deadline_timer import TICK, CheckPlan
from tests.core.transport.helpers import Add, Gate, ask
from tests.faults.harness import Bug, Lateness, milliseconds, percentile

pytestmark = pytest.mark.faults


def early(patch):
    patch(deadline_timer, "is_over", lambda deadline, now: deadline <= now + 0.05)


def late(patch):
    def expect(plan, deadline):
        plan.at, plan.threshold = deadline + 2.0, deadline

    patch(CheckPlan, "expect", expect)


def no_deadline_unless_said(patch):
    call = Client.call

    async def endless(self, request, *given, **more):
        self._timeout = None
        return await call(self, request, *given, **more)

    patch(Client, "call", endless)


async def heard(client, number, clock, **options):
    """Seconds until a call ends whose callback never answers."""
    began = clock()
    with pytest.raises(taskrpc.DeadlineExceeded):
        await asyncio.wait_for(client.call(ask(number), **options), 60)
    return clock() - began


@pytest.mark.planted(
    Bug(early, "early"), Bug(late, "over a tick late"), Bug(no_deadline_unless_said, "never")
)
async def test_calls_end_at_most_one_tick_after_their_deadline_and_never_early(counts, seed, large):
    chance = random.Random(seed)
    clock = asyncio.get_running_loop().time

    async def call(client, number):
        await asyncio.sleep(chance.uniform(0, 2))
        default = chance.random() < 0.1
        span = DEFAULT_TIMEOUT if default else chance.choice([0.001, 0.01, 0.1, chance.random()])
        try:
            took = await heard(client, number, clock, **({} if default else {"timeout": span}))
        except TimeoutError:
            counts["never"] += 1
            return
        except taskrpc.ServerBusy:
            counts["refused for load"] += 1
            return
        counts["deadlines"] += 1
        counts["without a timeout given"] += default
        counts["early"] += took < span - 1e-6
        counts["over a tick late"] += took > span + TICK + 1e-6

    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        # Executing calls, queued calls, and calls that wait to be sent.
        server.create_service(Add, "add", Gate(), concurrency=50)
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(5)
        await asyncio.gather(*[call(client, n) for n in range(20_000 if large else 2000)])
    counts.check(
        "early",
        "over a tick late",
        "never",
        happened=("deadlines", "without a timeout given"),
    )


@pytest.mark.real_time
@pytest.mark.planted(Bug(early, "early"), Bug(late, "over 20 ms later than the loop"))
async def test_real_calls_end_at_their_deadline_within_the_loops_delay(counts, seed, large):
    chance = random.Random(seed)
    late_by = []

    async def call(client, number):
        await asyncio.sleep(chance.uniform(0, 5 if large else 1))
        span = chance.uniform(0.05, 0.5)
        late_by.append(await heard(client, number, time.monotonic, timeout=span) - span)

    async with (
        taskrpc.Node("server", token="s") as server,
        taskrpc.Node("client", token="c") as node,
    ):
        server.create_service(Add, "add", Gate(), concurrency=1000)
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(5)
        lateness = Lateness()
        await asyncio.gather(*[call(client, n) for n in range(5000 if large else 300)])
        loop_late = lateness.stop()
    counts["deadlines"] = len(late_by)
    counts["early"] = sum(each < 0 for each in late_by)
    worst = percentile(late_by, 0.99)
    counts["over 20 ms later than the loop"] = worst > 0.020 + 2 * loop_late
    counts["p99 ms late"] = milliseconds(worst)
    counts["ms the loop was late"] = milliseconds(loop_late)
    counts.check("early", "over 20 ms later than the loop", happened=("deadlines",))
