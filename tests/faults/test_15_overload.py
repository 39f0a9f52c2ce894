"""Promise 15: four times a service's capacity costs at most a tenth of its goodput."""

import asyncio
import contextlib

import pytest

import taskrpc
from taskrpc.service import Service
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug, Counts

pytestmark = pytest.mark.faults

WORK = 0.05  # seconds that a call takes
CONCURRENCY = 4
PEAK = CONCURRENCY / WORK  # calls a second
CALLERS = 8  # together they may have more calls in flight than the queue holds


class Load:
    """Callers that send at a fixed rate, independent of the outcome of their calls."""

    def __init__(self, counts, deadline):
        self.counts = counts
        self.deadline = deadline
        self.started, self.refused = set(), set()
        self.ends = 0.0

    async def work(self, request, response):
        self.started.add(request.a)
        await asyncio.sleep(WORK)
        response.sum = request.a
        return response

    async def call(self, client, number):
        self.counts["calls"] += 1
        try:
            await client.call(ask(number), timeout=self.deadline)
            # Calls that are still queued when the load ends are answered too, and do not count.
            self.counts["answered"] += asyncio.get_running_loop().time() < self.ends
        except taskrpc.TaskRpcError as error:
            kind = "refused" if error.not_executed else "failed"
            self.counts[kind] += 1
            self.counts["busy"] += isinstance(error, taskrpc.ServerBusy)
            if error.not_executed:
                self.refused.add(number)

    async def run(self, times, seconds):
        async with contextlib.AsyncExitStack() as stack:
            names = ["server", *(f"caller{n}" for n in range(CALLERS))]
            nodes = [taskrpc.Node(each, transport="memory", token=each) for each in names]
            server, *callers = [await stack.enter_async_context(each) for each in nodes]
            server.create_service(Add, "work", self.work, concurrency=CONCURRENCY)
            clients = [each.create_client(Add, "work") for each in callers]
            for each in clients:
                await each.wait_for_service()
            loop, calls = asyncio.get_running_loop(), []
            began = loop.time()
            self.ends = began + seconds
            for number in range(int(times * PEAK * seconds)):
                await asyncio.sleep(max(0.0, began + number / (times * PEAK) - loop.time()))
                client = clients[number % CALLERS]
                calls.append(asyncio.ensure_future(self.call(client, number)))
            await asyncio.wait(calls)
        self.counts["refused and run"] = len(self.refused & self.started)


def begun_although_in_vain(patch):
    patch(Service, "_is_too_late", lambda self, call: False)


def refused_while_it_runs(patch):
    start = Service._start

    def hasty(self, call):
        started = start(self, call)
        if self._waiting.count > 10:
            call.fail(taskrpc.ServerBusy("planted"))
        return started

    patch(Service, "_start", hasty)


@pytest.mark.planted(
    Bug(begun_although_in_vain, "percent lost"),
    Bug(refused_while_it_runs, "refused and run"),
)
async def test_goodput_at_four_times_the_capacity_equals_the_peak(counts, large):
    seconds = 600 if large else 30
    for deadline in (0.2, 2.0, 60.0):
        here = Counts()
        await Load(here, deadline).run(4, seconds)
        share = here["answered"] / (PEAK * seconds)
        here["percent lost"] = max(0, round(90 - 100 * share))
        counts.update(here)
        here.check("percent lost", "refused and run", happened=("refused", "answered"))
        here.require(calls=9000)
        assert share < 1.01, "more than the peak: what is counted was not done under load"


async def test_load_within_capacity_is_answered_completely(counts):
    load = Load(counts, 2.0)
    await load.run(0.9, 30)
    counts.check("refused", "failed", "refused and run", happened=("answered",))
