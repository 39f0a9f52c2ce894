"""Promise 5: a request that the server has forgotten is refused as SessionExpired.

Copies of requests arrive late: after their client settled them, after its lease has ended, and
after restarts. On virtual time, below the network, so that thousands of days pass in seconds.
"""

import asyncio
import collections
import random

import pytest

import srvgen
import taskrpc
from taskrpc.core.request_ids.ids import ReceivedId, RequestCounter
from taskrpc.core.request_ids.ledger import CLIENT_LEASE, Ledger, Verdict
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import IncomingCall
from taskrpc.service import Service
from tests.faults.harness import Bug

pytestmark = pytest.mark.faults

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
CLIENTS = 20
BROKEN = ("ran twice", "a wrong answer")


def runs_what_was_settled(patch):
    _run_what_is_stale(patch, of_known_clients=True)


def runs_what_was_forgotten(patch):
    _run_what_is_stale(patch, of_known_clients=False)


def _run_what_is_stale(patch, *, of_known_clients):
    decide = Ledger.decide

    def careless(ledger, principal, received, now):
        is_known = (principal, received.client) in ledger._clients
        verdict = decide(ledger, principal, received, now)
        is_meant = verdict is Verdict.STALE and is_known == of_known_clients
        return Verdict.NEW if is_meant else verdict

    patch(Ledger, "decide", careless)


class FakeTransport:
    def offer(self, offer):
        self.serve = offer.serve

    def withdraw(self, offer):
        pass


class Call(IncomingCall, eq=False, kw_only=True):
    """One copy of a request and its response."""

    answer: object = None

    def reply(self, response, body=None):
        self.answer = response.sum

    def fail(self, error):
        self.answer = error


class Rehearsal:
    """Clients that number their requests, and a network that repeats requests days later."""

    def __init__(self, counts, seed):
        self.counts, self.chance = counts, random.Random(seed)
        self.store = taskrpc.MemoryCompletions()
        self.runs = collections.Counter()
        self.sent = []  # requests that may be repeated: client, sequence, first incomplete
        self.clients = []
        self.service = None

    async def run(self, steps):
        self.start_server()
        actions = {self.send: 10, self.repeat: 10, self.wait: 1, self.restart: 1}
        for _ in range(steps):
            (action,) = self.chance.choices(list(actions), list(actions.values()))
            await action()
        self.service.destroy()
        self.counts["ran twice"] = sum(count > 1 for count in self.runs.values())

    def start_server(self):
        self.transport = FakeTransport()
        self.service = Service(self.transport, Add, "/x", "/server", self.add, store=self.store)

    def add(self, request, response):
        self.runs[request.a, request.b] += 1
        response.sum = request.a + request.b
        return response

    async def restart(self):
        self.counts["restarts"] += 1
        self.service.destroy()
        await asyncio.sleep(0)
        self.start_server()

    async def wait(self):
        """The server forgets most clients in this time."""
        self.counts["leases"] += 1
        await asyncio.sleep(CLIENT_LEASE * self.chance.uniform(0.5, 1.5))

    async def send(self):
        if len(self.clients) < CLIENTS or self.chance.random() < 0.02:
            self.clients.append(RequestCounter(self.chance.randbytes(16)))
        number = self.chance.randrange(max(0, len(self.clients) - CLIENTS), len(self.clients))
        numbers = self.clients[number]
        sequence = numbers.take()
        counted = numbers.request_id(sequence)
        answer = await self.deliver(number, sequence, counted.first_incomplete)
        numbers.settle(sequence)
        if isinstance(answer, taskrpc.SessionExpired):  # the client starts a new numbering
            self.counts["clients that count anew"] += 1
            self.clients[number] = RequestCounter(self.chance.randbytes(16))
            return
        self.counts["a wrong answer"] += answer != number + sequence
        # A client's first request always looks the same, like one with a request id.
        if counted.first_incomplete > 1:
            self.sent.append((number, numbers.client, sequence, counted.first_incomplete))

    async def repeat(self):
        if not self.sent:
            return
        number, client, sequence, first = self.chance.choice(self.sent[-200:])
        answer = await self.deliver(number, sequence, first, client=client)
        is_refused = isinstance(answer, taskrpc.SessionExpired)
        self.counts["refused as expired" if is_refused else "answered again"] += 1
        self.counts["a wrong answer"] += not is_refused and answer != number + sequence

    async def deliver(self, number, sequence, first, *, client=None):
        loop = asyncio.get_running_loop()
        client = client or self.clients[number].client
        received = ReceivedId(client, sequence, first, b"")
        # `a` distinguishes requests of two clients that have the same number in `clients`.
        a = number + 1000 * int.from_bytes(client[:4], "big")
        request = Add.Request(a=a, b=sequence)
        who = "/x", "/me", "", Role.ADMIN, 1, None, loop.time
        call = Call(*who, request=request, received_id=received, arrived=loop.time())
        self.transport.serve(call)
        for _ in range(20):
            if call.answer is not None:
                break
            await asyncio.sleep(0)
        return call.answer if isinstance(call.answer, Exception) else call.answer - a + number


@pytest.mark.planted(
    Bug(runs_what_was_settled, "ran twice"), Bug(runs_what_was_forgotten, "ran twice")
)
async def test_late_copies_of_requests_are_never_executed(counts, seed, large):
    rehearsal = Rehearsal(counts, seed)
    await rehearsal.run(200_000 if large else 5000)
    counts.check(
        *BROKEN,
        happened=("refused as expired", "answered again", "clients that count anew", "restarts"),
    )
