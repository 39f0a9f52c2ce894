"""Promises 4 and 6: despite any fault a plain call executes at most once, and its caller learns
whether it did, or that the outcome is unknown."""

import asyncio
import collections
import random

import pytest

import taskrpc
from taskrpc.core.attempts import Attempts
from taskrpc.core.transport import pipe
from taskrpc.core.transport.connection import client_side
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug
from tests.faults.proxy import CUT, DELAY, HOLE, RESET, TRUNCATE, Faults, Proxy, faulty_pipe

pytestmark = pytest.mark.faults

BROKEN = (
    "ran twice",
    "told that it did not run, but it did",
    "told that it ran, but it did not",
    "wrong answer",
    "no answer",
)
TOLD = ("answered", "told unknown", "told not run", "sent again", "given up")


class Truth:
    """A service that records its executions, and callers whose outcomes are compared with them."""

    def __init__(self, chance, counts, span=0.5):
        self.chance, self.counts, self.span = chance, counts, span
        self.runs = collections.Counter()
        self.told = {}

    async def run(self, request, response):
        if self.chance.random() < 0.1:
            self.counts["refused by the callback"] += 1
            raise taskrpc.HandlerError("UNAVAILABLE", "not now")
        self.runs[request.a] += 1
        if request.b:
            await asyncio.sleep(request.b / 1000)
        response.sum = -request.a
        return response

    async def call(self, client, number):
        chance = self.chance
        await asyncio.sleep(chance.uniform(0, self.span))
        retry = chance.choice([None, taskrpc.RetryPolicy(), taskrpc.RetryPolicy(attempts=3)])
        takes = chance.choice([0, 0, 1, 50])
        job = asyncio.ensure_future(client.call(ask(number, takes), timeout=1.5, retry=retry))
        if chance.random() < 0.1:
            asyncio.get_running_loop().call_later(chance.uniform(0, 0.05), job.cancel)
        # Two timeouts: a call that has no response by then never gets one.
        done, _ = await asyncio.wait([job], timeout=3.0)
        self.counts["no answer"] += not done
        job.cancel()
        self._note(number, (await asyncio.gather(job, return_exceptions=True))[0])

    def _note(self, number, got):
        self.counts["calls"] += 1
        if isinstance(got, asyncio.CancelledError):
            self.counts["given up"] += 1
        elif isinstance(got, taskrpc.TaskRpcError):
            self.told[number] = got.not_executed
            verdict = {True: "told not run", False: "told run", None: "told unknown"}
            self.counts[verdict[got.not_executed]] += 1
        elif isinstance(got, Exception):
            raise got
        else:
            self.told[number] = False
            self.counts["answered"] += 1
            self.counts["wrong answer"] += got.sum != -number

    def judge(self):
        """Compare the callers' outcomes with the executions, after everything has ended."""
        self.counts["runs"] += self.runs.total()
        self.counts["ran twice"] += sum(count > 1 for count in self.runs.values())
        for number, not_executed in self.told.items():
            ran = self.runs[number] > 0
            if not_executed is True and ran:
                self.counts["told that it did not run, but it did"] += 1
            if not_executed is False and not ran:
                self.counts["told that it ran, but it did not"] += 1


@pytest.fixture(autouse=True)
def _count_retries(counts, monkeypatch):
    wait = Attempts._wait_after

    def counted(attempts, error):
        seconds = wait(attempts, error)
        counts["sent again"] += seconds is not None
        return seconds

    monkeypatch.setattr(Attempts, "_wait_after", counted)


def repeats_what_may_have_run(patch):
    patch(Attempts, "_may_repeat", lambda self, error: isinstance(error, taskrpc.ConnectionLost))
    patch(Attempts, "_end_in_doubt", lambda self, problem: None)


def guesses_that_nothing_ran(patch):
    def guess():
        return taskrpc.OutcomeUnknown("the connection was lost", not_executed=True)

    patch(client_side, "unknown_error", guess)


def tells_nobody_that_the_connection_is_lost(patch):
    def ended(connection):
        connection.epoch += 1

    patch(client_side.CallingConnection, "ended", ended)
    patch(client_side.OpenCall, "expired", lambda call: None)


@pytest.mark.planted(
    Bug(repeats_what_may_have_run, "ran twice"),
    Bug(guesses_that_nothing_ran, "told that it did not run, but it did"),
    Bug(tells_nobody_that_the_connection_is_lost, "no answer"),
)
async def test_calls_in_memory_execute_at_most_once_and_callers_know_the_outcome(
    counts, seed, large, monkeypatch
):
    for number in range(100_000 if large else 1000):
        chance = random.Random(f"{seed} {number}")
        counts["seeds"] += 1
        with monkeypatch.context() as patch:
            # The handshake has about 250 bytes, a call 60.
            faults = Faults(chance, counts, skip=chance.choice([0, 250]), reach=900)
            patch.setattr(pipe, "Pipe", faulty_pipe(faults))
            await _one_seed(Truth(chance, counts))
        if counts.broken(*BROKEN) and number >= 200:
            print(f"broken by the faults of number {number}")
            break
    kinds = (DELAY, TRUNCATE, CUT, RESET, HOLE)
    counts.check(*BROKEN, happened=(*kinds, *TOLD))


async def _one_seed(truth):
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "add", truth.run, concurrency=4)
        client = node.create_client(Add, "add")
        await asyncio.gather(*[truth.call(client, number) for number in range(1, 9)])
        await asyncio.sleep(5)  # all frames on their way have arrived
        truth.judge()


@pytest.mark.real_time
@pytest.mark.planted(Bug(repeats_what_may_have_run, "ran twice"))
async def test_calls_on_sockets_execute_at_most_once_and_callers_know_the_outcome(
    counts, seed, large
):
    kinds = (DELAY, TRUNCATE, CUT, RESET)
    for number in range(1000 if large else 24):
        chance = random.Random(f"{seed} {number}")
        kind = kinds[number % len(kinds)]  # one after the other: the machine's timing is not seeded
        faults = Faults(chance, counts, kinds=(kind,), skip=200, reach=1500)
        truth = Truth(chance, counts, span=0.05)
        counts["seeds"] += 1
        async with (
            taskrpc.Node("server", listen="127.0.0.1:0", token="t") as server,
            _served(server, truth),
            Proxy(server.address, faults) as proxy,
            taskrpc.Node("client", peers=[proxy.address], token="t") as node,
        ):
            client = node.create_client(Add, "add")
            await asyncio.gather(*[truth.call(client, number) for number in range(1, 41)])
            # The longest callback has ended by now.
            await asyncio.sleep(0.1)
        truth.judge()
        if counts.broken(*BROKEN):
            break
    counts.check(*BROKEN, happened=(*kinds, "answered", "told unknown", "sent again"))


class _served:
    """Creates the service before the proxy requests the server's address."""

    def __init__(self, server, truth):
        server.create_service(Add, "add", truth.run, concurrency=8)
        self._server = server

    async def __aenter__(self):
        return self

    async def __aexit__(self, *_):
        await self._server.drain(5)
