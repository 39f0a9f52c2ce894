"""Promise 3: cancelling a call cancels its async callback and leaves nothing behind."""

import asyncio
import collections
import contextlib
import random

import pytest

from taskrpc.core.transport.connection.client_side import CallingConnection
from taskrpc.core.transport.connection.server_side import ServingConnection
from taskrpc.core.wire.events import CancelReceived
from taskrpc.core.wire.session import Session
from taskrpc.service import Service
from tests.core.transport.helpers import Gate, ask
from tests.faults.clients import clients_of
from tests.faults.harness import Bug

pytestmark = pytest.mark.faults

LEFT = ("callbacks that run on", "tasks left", "call ids left", "timers left")


def never_tells_the_server(patch):
    patch(CallingConnection, "forget", lambda connection, call: None)


def never_stops_the_callback(patch):
    cancelled = ServingConnection._cancelled

    def deaf(connection, event):
        if event.request.ticket is not None:
            event.request.ticket.on_cancel = None
        cancelled(connection, event)

    patch(ServingConnection, "handlers", {**ServingConnection.handlers, CancelReceived: deaf})


def never_answers_what_was_cancelled_in_the_queue(patch):
    def deaf(connection, event):
        if event.request.ticket is not None:
            event.request.ticket.cancel()

    patch(ServingConnection, "handlers", {**ServingConnection.handlers, CancelReceived: deaf})
    patch(Service, "_job_done", _job_done_without_an_answer)


def _job_done_without_an_answer(service, call, job):
    _, began = service._jobs.pop(call)
    service._stored(began)


class Sessions:
    """Records every session, so that its contents can be counted."""

    def __init__(self, monkeypatch):
        self.all = []
        init = Session.__init__

        def noted(session, *arguments, **options):
            init(session, *arguments, **options)
            self.all.append(session)

        monkeypatch.setattr(Session, "__init__", noted)

    def open_calls(self):
        return sum(len(session.open_calls) for session in self.all)


def timers():
    """The scheduled timers, without those of the connections themselves."""
    loop = asyncio.get_running_loop()
    return sum(not handle.cancelled() for handle in loop._scheduled)


@pytest.mark.planted(
    Bug(never_tells_the_server, "callbacks that run on"),
    Bug(never_stops_the_callback, "callbacks that run on"),
)
async def test_each_cancel_of_1000_calls_cancels_its_callback(counts, seed, large, monkeypatch):
    sessions, gate = Sessions(monkeypatch), Gate()
    async with clients_of(gate, 5, concurrency=1000) as clients:
        before = len(asyncio.all_tasks()), timers()
        calls = [clients[n % 5].call_async(ask(n), timeout=None) for n in range(1000)]
        await asyncio.sleep(0.1)
        counts["in flight"] = len(gate.started)
        random.Random(seed).shuffle(calls)
        for call in calls:
            call.cancel()
        await asyncio.sleep(1)
        counts["callbacks cancelled"] = len(gate.cancelled)
        counts["callbacks that run on"] = len(gate.started) - len(gate.cancelled)
        count_what_is_left(counts, sessions, before)
    assert counts["in flight"] == 1000
    counts.check(*LEFT, happened=("callbacks cancelled",))


@pytest.mark.planted(Bug(never_answers_what_was_cancelled_in_the_queue, "call ids left"))
async def test_10000_random_cancels_leave_nothing_behind(counts, seed, large, monkeypatch):
    sessions, chance = Sessions(monkeypatch), random.Random(seed)
    states = collections.Counter()

    async def work(request, response):
        states["running"] += 1
        try:
            await asyncio.sleep(request.b / 1000)
        except asyncio.CancelledError:
            counts["cancelled in the callback"] += 1
            raise
        finally:
            states["running"] -= 1
        response.sum = request.a
        return response

    async def call(client, number):
        await asyncio.sleep(chance.uniform(0, 5))
        takes = chance.choice([0, 1, 10, 60_000])
        call = client.call_async(ask(number, takes), timeout=None)
        # Cancelled at once, a few iterations later, in any queue, in the callback, or at its end.
        for _ in range(chance.randrange(8)):
            await asyncio.sleep(0)
        await asyncio.sleep(chance.choice([0, 0, 0.001, 0.01, chance.random()]))
        counts["cancelled"] += call.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            answer = await call
            counts["answered first"] += answer.sum == number

    async with clients_of(work, 5, concurrency=100) as clients:
        before = len(asyncio.all_tasks()), timers()
        wanted = 10_000
        for _ in range(10 if large else 1):
            await asyncio.gather(*[call(clients[n % 5], n) for n in range(wanted)])
        await asyncio.sleep(1)
        counts["callbacks that run on"] = states["running"]
        count_what_is_left(counts, sessions, before)
    counts.check(*LEFT, happened=("cancelled", "answered first", "cancelled in the callback"))


def count_what_is_left(counts, sessions, before):
    tasks, set_timers = before
    counts["tasks left"] = max(0, len(asyncio.all_tasks()) - tasks)
    counts["call ids left"] = sessions.open_calls()
    counts["timers left"] = max(0, timers() - set_timers)
