"""Promise 2: the deadline is sent as the time left, and expired calls are not executed."""

import asyncio
import random

import pytest

import taskrpc
from taskrpc import service
from taskrpc.core.transport.connection import incoming_call, server_side
from taskrpc.core.wire.events import RequestReceived
from tests.core.transport.helpers import ask, outcome
from tests.faults.clients import clients_of
from tests.faults.harness import Bug

pytestmark = pytest.mark.faults

SPAN = 0.1
ROUNDING = 0.001 + 1e-6
"""Seconds: the time left is sent in whole milliseconds, rounded up."""


def runs_whatever_waited(patch):
    start = service.Service._start

    def careless(self, call):
        call.deadline = None
        return start(self, call)

    patch(service.Service, "_start", careless)
    patch(service.Service, "_is_too_late", lambda self, call: False)


def counts_from_when_a_request_is_handled(patch):
    requested = server_side.ServingConnection.requested

    def late(connection, event):
        connection.read_at = connection.server.now()
        requested(connection, event)

    handlers = {**server_side.ServingConnection.handlers, RequestReceived: late}
    patch(server_side.ServingConnection, "handlers", handlers)
    patch(server_side.ServingConnection, "requested", late)


def says_nothing_of_what_it_cancels(patch):
    fail = incoming_call.RemoteCall.fail

    def silent(call, error):
        error.not_executed = None
        fail(call, error)

    patch(incoming_call.RemoteCall, "fail", silent)


def says_that_nothing_had_begun(patch):
    cancel = incoming_call.RemoteCall.cancel

    def careless(call):
        cancel(call)
        call.started = False

    patch(incoming_call.RemoteCall, "cancel", careless)


class Clock:
    """The deadline of each call, by the one clock of caller and callback."""

    def __init__(self, counts, unread=0.0):
        self.loop, self.counts, self.due = asyncio.get_running_loop(), counts, {}
        self.tolerance = ROUNDING + unread
        self.begun = set()

    def started(self, number):
        self.counts["started"] += 1
        self.begun.add(number)
        self.counts["started after expiry"] += self.loop.time() > self.due[number] + self.tolerance

    async def call(self, client, number):
        self.due[number] = self.loop.time() + SPAN
        got = await outcome(client.call(ask(number), timeout=SPAN))
        if isinstance(got, taskrpc.DeadlineExceeded):
            self.counts["expired"] += 1
            is_known = got.not_executed is True
            self.counts["known not to have run"] += is_known
            self.counts["not begun, and not told"] += not is_known and number not in self.begun
            self.counts["begun, and told the contrary"] += is_known and number in self.begun
        elif isinstance(got, taskrpc.ServerBusy):
            self.counts["refused for load"] += 1
        else:
            self.counts["answered"] += 1


@pytest.mark.planted(
    Bug(runs_whatever_waited, "started after expiry"),
    Bug(says_nothing_of_what_it_cancels, "not begun, and not told"),
    Bug(says_that_nothing_had_begun, "begun, and told the contrary"),
)
async def test_none_of_5000_queued_calls_starts_after_its_deadline(counts, seed, large):
    clock, chance = Clock(counts), random.Random(seed)

    async def busy(request, response):
        clock.started(request.a)
        await asyncio.sleep(chance.choice([0, 0.001, 0.03]))
        return response

    async def later(client, number):
        await asyncio.sleep(chance.uniform(0, 1))
        await clock.call(client, number)

    async with clients_of(busy, 25) as clients:
        wanted = 50_000 if large else 5000
        await asyncio.gather(*[later(clients[n % 25], n) for n in range(wanted)])
    counts.check(
        "started after expiry",
        "not begun, and not told",
        "begun, and told the contrary",
        happened=("started", "answered", "expired"),
    )


@pytest.mark.planted(
    Bug(runs_whatever_waited, "started after expiry"),
    Bug(counts_from_when_a_request_is_handled, "started after expiry"),
)
async def test_no_call_starts_after_its_deadline_behind_a_blocking_callback(counts, seed, large):
    # A request that is unread while a callback blocks the loop cannot expire earlier.
    clock, chance = Clock(counts, unread=0.03), random.Random(seed)

    def busy(request, response):
        clock.started(request.a)
        clock.loop.advance(chance.choice([0.001, 0.004, 0.03]))
        return response

    async with clients_of(busy, 1) as (client,):
        for first in range(0, 50_000 if large else 5000, 250):
            numbers = range(first, first + 250)
            await asyncio.gather(*[clock.call(client, number) for number in numbers])
    counts.check("started after expiry", happened=("started", "answered", "expired"))
