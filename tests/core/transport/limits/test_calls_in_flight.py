"""One student's endless loop takes neither the turns nor the memory of the other students."""

import asyncio
import contextlib
import itertools

import pytest

import taskrpc
from taskrpc import Account, Accounts
from taskrpc.core.transport import memory
from taskrpc.core.transport.connection.connection import Connection
from taskrpc.core.transport.limits import admission, calls_in_flight
from taskrpc.core.wire.frames import LARGE
from tests.core.transport.helpers import Add, Gate, Text, add, ask, outcome, until

CLASS = Account("class", "one secret for the whole class".replace(" ", "_"))


class Lab:
    """A server, and programs on laptops that all use the join string of the class."""

    def __init__(self, stack, monkeypatch):
        self._stack = stack
        self._address = "192.0.2.0"
        self._ports, self._count = itertools.count(1), itertools.count()
        monkeypatch.setattr(memory, "join", self._joined)

    def _joined(self, client, server, name, join=memory.join, **settings):
        ends = join(client, server, name, **settings)
        ends[1]._extra["peername"] = (self._address, next(self._ports))
        return ends

    async def node(self, name, **options):
        """A program with sockets of its own."""
        options.setdefault("listen", f"{name} {next(self._count)}")
        node = taskrpc.Node(name, transport="memory", **options)
        return await self._stack.enter_async_context(node)

    async def server(self):
        return await self.node("server", accounts=Accounts([CLASS]))

    async def client(self, laptop, name="work", srv_type=Add, **options):
        """A client in a program of its own on a laptop, connected."""
        self._address = f"192.0.2.{laptop}"
        node = await self.node("student", token=CLASS.token)
        options.setdefault("timeout", None)
        client = node.create_client(srv_type, f"/{name}", **options)
        assert await client.wait_for_service(60)
        return client


@pytest.fixture
async def lab(monkeypatch):
    async with contextlib.AsyncExitStack() as stack:
        yield Lab(stack, monkeypatch)


def holding(client):
    """The calling end of a client's connection."""
    return client._channel._connection


@pytest.mark.parametrize("once", [False, True])
async def test_the_laptops_of_one_account_take_turns(lab, once):
    order = []

    async def work(request, response):
        order.append(request.a)
        await asyncio.sleep(0.01)
        return response

    server = await lab.server()
    store = taskrpc.MemoryCompletions() if once else None
    server.create_service(Add, "work", work, concurrency=1, exactly_once=store)
    heavy = [await lab.client(1) for _ in range(3)]  # programs of one laptop
    modest = await lab.client(2)
    calls = [client.call_async(ask(n)) for n in range(40) for client in heavy]
    await until(lambda: len(order) == 3)
    place = len(order)
    await asyncio.gather(*[modest.call(ask(1000 + n)) for n in range(3)])
    assert len(order) <= place + 7, "each waited for one call of the other laptop"
    await asyncio.gather(*calls)


async def test_one_laptop_cannot_have_more_calls_in_flight_than_are_left_for_others(
    lab, monkeypatch
):
    monkeypatch.setattr(calls_in_flight, "MAX_CALLS", 400)
    gate, server = Gate(), await lab.server()
    server.create_service(Add, "work", gate, concurrency=1000)
    heavy = [await lab.client(1) for _ in range(5)]
    calls = [client.call_async(ask(n)) for n, client in enumerate(heavy * 100)]
    await asyncio.sleep(0.5)
    refused = [call.exception() for call in calls if call.done()]
    assert all(isinstance(each, taskrpc.ServerBusy) for each in refused)
    assert all(each.not_executed and each.retry_after > 0 for each in refused)
    assert 200 <= len(gate.started) <= 200 + 5 * calls_in_flight.FREE.calls
    assert len(gate.started) + len(refused) == 500
    modest = await lab.client(2)
    others = [modest.call_async(ask(1000 + n)) for n in range(90)]
    await until(lambda: len(gate.started) + len(refused) == 590)
    gate.opened.set()
    assert [each.sum for each in await asyncio.gather(*others)] == list(range(1000, 1090))
    answered = [each for each in await asyncio.gather(*map(outcome, calls)) if hasattr(each, "sum")]
    assert len(answered) == len(gate.started) - 90


async def test_refused_calls_succeed_when_they_are_retried(lab, monkeypatch):
    monkeypatch.setattr(calls_in_flight, "MAX_CALLS", 100)

    async def work(request, response):
        await asyncio.sleep(0.05)
        return add(request, response)

    server = await lab.server()
    server.create_service(Add, "work", work, concurrency=1000)
    clients = [await lab.client(1, timeout=600, retry=taskrpc.RetryPolicy()) for _ in range(3)]
    calls = [client.call_async(ask(n)) for n in range(100) for client in clients]
    assert sorted(each.sum for each in await asyncio.gather(*calls)) == sorted([*range(100)] * 3)
    assert sum(client.retries for client in clients) > 10


async def test_shares_come_back_when_calls_end_and_when_connections_do(lab, monkeypatch):
    monkeypatch.setattr(calls_in_flight, "MAX_CALLS", 1000)
    gate, server = Gate(), await lab.server()
    server.create_service(Add, "work", gate, concurrency=1000)
    shares = server._transport.calls_in_flight._calls
    client, other = await lab.client(1), await lab.client(1)
    calls = [each.call_async(ask(n)) for n in range(100) for each in (client, other)]
    await until(lambda: len(gate.started) == 200)
    assert shares.left <= 1000 - 200 + 2 * calls_in_flight.FREE.calls
    holding(other).abort(taskrpc.ConnectionLost("gone"))
    await until(lambda: len(gate.cancelled) == 100)
    assert 800 <= shares.left <= 900 + calls_in_flight.FREE.calls
    gate.opened.set()
    await asyncio.gather(*map(outcome, calls))
    await asyncio.sleep(3)
    assert shares.left == 1000
    assert not server._transport.calls_in_flight._lent


@pytest.mark.parametrize("size", [3 * LARGE, 20 * LARGE])
async def test_large_requests_beyond_a_laptops_share_are_refused_before_they_are_here(
    lab, monkeypatch, size
):
    monkeypatch.setattr(calls_in_flight, "MAX_BYTES", 100 * LARGE)
    begun, gate = [], asyncio.Event()

    async def slow(request, response):
        begun.append(len(request.target))
        await gate.wait()
        return response

    server = await lab.server()
    server.create_service(Text, "take", slow, concurrency=1000)
    server.create_service(Add, "work", add)
    heavy = [await lab.client(1, "take", Text) for _ in range(8)]
    request = Text.Request(target="x" * size)
    calls = [client.call_async(request) for client in heavy * 5]
    await asyncio.sleep(1)
    refused = [call.exception() for call in calls if call.done()]
    assert refused
    assert all(isinstance(each, taskrpc.ServerBusy) for each in refused)
    assert all("bytes of requests" in str(each) and each.not_executed for each in refused)
    assert len(begun) + len(refused) == len(calls)
    free = 8 * calls_in_flight.FREE.bytes
    assert sum(begun) <= 50 * LARGE + free
    assert all(not each._splitter.large for each in server._transport._served)
    modest, small = await lab.client(2, "take", Text), await lab.client(1)
    assert (await small.call(ask(1, 2))).sum == 3
    another = modest.call_async(Text.Request(target="y" * 10 * LARGE))
    await until(lambda: begun[-1] == 10 * LARGE)
    gate.set()
    await another
    await asyncio.gather(*map(outcome, calls))
    assert (await heavy[0].call(Text.Request(target="z" * 10 * LARGE))) is not None


async def test_a_request_that_is_announced_and_never_sent_costs_only_its_caller(lab, monkeypatch):
    monkeypatch.setattr(calls_in_flight, "MAX_BYTES", 100 * LARGE)
    server = await lab.server()
    server.create_service(Text, "take", lambda request, response: response)
    # Without the checks, no caller is disconnected.
    monkeypatch.setattr(Connection, "tick", lambda connection, now: None)
    heavy = [await lab.client(1, "take", Text) for _ in range(8)]
    for client in heavy:
        connection = holding(client)
        call_id = connection.session.request(None, 1, b"", 10_000)
        connection.session.take()
        header = load_header(call_id, 20 * LARGE)
        connection.transport.write(header + bytes(LARGE))
    await asyncio.sleep(0.1)
    kept = [each._splitter.large for each in server._transport._served if each._splitter.large]
    assert len(kept) == 8
    assert sum(each.size for each in kept) <= 50 * LARGE
    modest = await lab.client(2, "take", Text)
    await modest.call(Text.Request(target="y" * 20 * LARGE))


def load_header(call_id, size):
    from taskrpc.core.wire.frames import FrameType, pack_header

    return pack_header(FrameType.REQUEST, 0, 1, call_id, 10_000, size)


async def test_refusals_over_the_fair_share_are_observed_and_throttled_in_the_log(
    lab, monkeypatch, caplog
):
    monkeypatch.setattr(calls_in_flight, "MAX_CALLS", 10)
    metrics, gate = taskrpc.Metrics(), Gate()
    server = await lab.node("server", accounts=Accounts([CLASS]), observer=metrics)
    server.create_service(Add, "work", gate, concurrency=1000)
    client = await lab.client(1)
    calls = [client.call_async(ask(n)) for n in range(100)]
    await until(lambda: any(call.done() for call in calls))
    assert 'code="RESOURCE_EXHAUSTED"' in metrics.text()
    line = (
        "refused calls: the account class at the machine 192.0.2.1 has used its fair share of calls"
    )
    assert caplog.text.count(line) == 1
    gate.opened.set()
    await asyncio.gather(*map(outcome, calls))


async def test_the_laptop_with_most_connections_gives_one_to_another_of_its_class(lab, monkeypatch):
    monkeypatch.setattr(admission, "MAX_CONNECTIONS", 4)
    server = await lab.server()
    server.create_service(Add, "work", add)
    heavy = [await lab.client(1) for _ in range(4)]
    for laptop in (2, 3):
        modest = await lab.client(laptop)
        assert (await modest.call(ask(1, 2))).sum == 3
    await asyncio.sleep(1)
    places = sorted(each.quota_key for each in server._transport._served)
    assert places.count(("class", "192.0.2.1")) == 2
    assert {("class", "192.0.2.2"), ("class", "192.0.2.3")} < set(places)
    assert len(heavy) == 4
