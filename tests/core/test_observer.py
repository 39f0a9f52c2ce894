"""An observer learns of each call once, with the code that its caller gets; others pay nothing."""

import asyncio

import pytest

import taskrpc
import taskrpc.sync
from taskrpc import Code
from tests.core.transport.helpers import Add, Gate, add, ask


class Log(taskrpc.Observer):
    """Records the notifications that it gets."""

    def __init__(self):
        self.began, self.ended, self.requests, self.nodes = [], [], [], []

    def node_started(self, node):
        self.nodes.append(node.get_fully_qualified_name())

    def node_ended(self, node):
        self.nodes.remove(node.get_fully_qualified_name())

    def call_began(self, call):
        self.began.append(call.number)

    def call_ended(self, call, code, seconds):
        assert seconds >= 0
        self.ended.append((call.number, code))

    def request_ended(self, service, code, seconds):
        self.requests.append((service, code, seconds))

    @property
    def codes(self):
        return [code for _, code in self.ended]


class Pair:
    """A server and a client in one process, each with its observer."""

    def __init__(self):
        self.server_log, self.client_log = Log(), Log()
        self.server = taskrpc.Node(
            "server", transport="memory", token="server", observer=self.server_log
        )
        self.client = taskrpc.Node(
            "client", transport="memory", token="client", observer=self.client_log
        )

    async def __aenter__(self):
        await self.server.start()
        await self.client.start()
        return self

    async def __aexit__(self, *_):
        await self.client.destroy()
        await self.server.destroy()

    def offer(self, callback, srv_type=Add, **options):
        self.server.create_service(srv_type, "work", callback, **options)
        return self.client.create_client(srv_type, "work")


@pytest.fixture
async def pair():
    async with Pair() as made:
        yield made


def refuse(request, response):
    raise taskrpc.HandlerError("NOT_FOUND", "no such place")


def fail(request, response):
    raise OSError("no battery")


async def suspending(request, response):
    await asyncio.sleep(1)
    return add(request, response)


@pytest.mark.parametrize(
    ("callback", "code"),
    [(add, Code.OK), (suspending, Code.OK), (refuse, Code.NOT_FOUND), (fail, Code.INTERNAL)],
)
async def test_observers_of_both_sides_get_the_same_code_once(pair, callback, code):
    client = pair.offer(callback)
    for _ in range(2):
        try:
            await client.call(ask())
        except taskrpc.TaskRpcError:
            assert code is not Code.OK
    log = pair.server_log
    assert log.ended == [(number, code) for number in log.began]
    assert [(name, each) for name, each, _ in pair.client_log.requests] == [("/work", code)] * 2


async def test_a_deadline_ends_a_call_once_although_its_callback_answers_later(pair):
    async def late(request, response):
        try:
            await asyncio.sleep(60)
        except asyncio.CancelledError:
            return response

    client = pair.offer(late)
    with pytest.raises(taskrpc.DeadlineExceeded):
        await client.call(ask(), timeout=1)
    await asyncio.sleep(1)
    assert pair.server_log.codes in ([Code.DEADLINE_EXCEEDED], [Code.CANCELLED])
    assert pair.client_log.requests[0][1:] == (Code.DEADLINE_EXCEEDED, pytest.approx(1, abs=0.01))


async def test_cancelled_call_is_reported_to_both_observers(pair):
    client = pair.offer(Gate())
    call = asyncio.ensure_future(client.call(ask()))
    future = client.call_async(ask())
    await asyncio.sleep(1)
    call.cancel()
    future.cancel()
    await asyncio.sleep(1)
    assert [code for _, code, _ in pair.client_log.requests] == [Code.CANCELLED] * 2
    assert pair.server_log.codes == [Code.CANCELLED] * 2


async def test_an_observer_that_raises_is_logged_and_harms_no_call(caplog):
    class Broken(taskrpc.Observer):
        def call_began(self, call):
            raise RuntimeError("broken")

        call_ended = node_started = node_ended = request_began = request_ended = call_began

    async with (
        taskrpc.Node("server", transport="memory", token="server", observer=Broken()) as server,
        taskrpc.Node("client", transport="memory", token="client", observer=Broken()) as node,
    ):
        server.create_service(Add, "work", add)
        response = await node.create_client(Add, "work").call(ask(2, 3))
    assert response.sum == 5
    assert "an observer failed" in caplog.text


async def test_several_observers_get_the_same_reports_although_one_raises(caplog):
    class Broken(taskrpc.Observer):
        def call_began(self, call):
            raise RuntimeError("broken")

        call_ended = node_started = node_ended = request_began = request_ended = call_began

    logs = [Log(), Log()]
    observer = taskrpc.Observers(logs[0], Broken(), logs[1])
    async with taskrpc.Node("node", transport="memory", observer=observer) as node:
        assert [log.nodes for log in logs] == [["/node"]] * 2
        node.create_service(Add, "work", add)
        await node.create_client(Add, "work").call(ask())
    for log in logs:
        assert (len(log.began), log.codes, len(log.requests)) == (1, [Code.OK], 1)
        assert log.nodes == []


async def test_observer_gets_reports_of_its_own_nodes_only():
    log = Log()
    async with taskrpc.Node("watched", transport="memory", observer=log) as watched:
        assert log.nodes == ["/watched"]
        async with taskrpc.Node("other", transport="memory") as other:
            other.create_service(Add, "theirs", add)
            watched.create_service(Add, "ours", add)
            client = other.create_client(Add, "theirs")
            await client.call(ask())
            await other.create_client(Add, "ours").call(ask())
    assert log.nodes == []
    assert len(log.began) == 1
    assert log.requests == []


async def test_status_of_a_node_counts_calls_and_connections(pair):
    gate = Gate()
    client = pair.offer(gate)
    calls = [asyncio.ensure_future(client.call(ask())) for _ in range(3)]
    await asyncio.sleep(1)
    status = pair.server.status()
    assert [(each.name, each.running, each.waiting) for each in status.services] == [
        ("/work", 1, 2)
    ]
    assert (status.accepted.opened, status.accepted.open) == (1, 1)
    theirs = pair.client.status()
    assert status.accepted.received == theirs.dialled.sent > 0
    assert status.endpoint != theirs.endpoint
    gate.opened.set()
    await asyncio.gather(*calls)
    await pair.client.destroy()
    await asyncio.sleep(1)
    after = pair.server.status().accepted
    assert (after.opened, after.open, sum(after.ended.values())) == (1, 0, 1)
    assert after.received >= status.accepted.received


@pytest.mark.real_time
def test_a_blocking_program_is_observed_too():
    log = Log()
    with taskrpc.sync.Node("blocking", observer=log) as node:
        node.create_service(Add, "work", add)
        client = node.create_client(Add, "work")
        assert [client.call(ask(1, 2)).sum for _ in range(3)] == [3, 3, 3]
        assert [each.name for each in node.status().services] == ["/work"]
    assert log.codes == [Code.OK] * 3
    assert [code for _, code, _ in log.requests] == [Code.OK] * 3


async def test_retries_of_destroyed_clients_are_counted(pair):
    answers = iter([taskrpc.HandlerError("UNAVAILABLE", "not yet")] * 2)

    def reluctant(request, response):
        for error in answers:
            raise error
        return add(request, response)

    client = pair.offer(reluctant)
    await client.call(ask(), retry=taskrpc.RetryPolicy())
    assert pair.client.status().retries == {"/work": 2}
    client.destroy()
    assert pair.client.status().retries == {"/work": 2}
    assert len(pair.client_log.requests) == 1


class Spans(taskrpc.Observer):
    """Tells spans of its own, and notes those of others."""

    def __init__(self, span=b""):
        self.span = span
        self.seen, self.ends = [], []

    def request_began(self, service):
        return self

    def ended(self, code, seconds):
        self.ends.append(code)

    def call_began(self, call):
        self.seen.append(call.span)


@pytest.mark.parametrize("once", [False, True])
async def test_server_knows_the_span_of_the_caller(once):
    ours, theirs = Spans(bytes(range(25))), Spans()
    async with (
        taskrpc.Node("server", transport="memory", token="s", observer=theirs) as server,
        taskrpc.Node("client", transport="memory", token="c", observer=ours) as node,
        taskrpc.Node("other", transport="memory", token="o") as other,
    ):
        store = taskrpc.MemoryCompletions() if once else None
        server.create_service(Add, "work", add, exactly_once=store)
        client, plain = node.create_client(Add, "work"), other.create_client(Add, "work")
        assert (await client.call(ask(2, 3))).sum == 5
        assert (await plain.call(ask(2, 4))).sum == 6
        assert (await client.call_async(ask(2, 5))).sum == 7
        ours.span = b""
        assert (await client.call(ask(2, 6))).sum == 8
    assert theirs.seen == [bytes(range(25)), b"", bytes(range(25)), b""]
    assert ours.ends == [Code.OK] * 3


async def test_each_sending_of_a_request_has_the_span_of_its_call():
    theirs = Spans()
    spans = iter([b"a" * 25, b"b" * 25])

    class Two(taskrpc.Observer):
        def request_began(self, service):
            return Spans(next(spans))

    def busy(request, response):
        if len(theirs.seen) <= 4:
            raise taskrpc.HandlerError("UNAVAILABLE", "not yet")
        return response

    async with (
        taskrpc.Node("server", transport="memory", token="s", observer=theirs) as server,
        taskrpc.Node("client", transport="memory", token="c", observer=Two()) as node,
    ):
        server.create_service(Add, "work", busy, idempotent=True)
        client = node.create_client(Add, "work", retry=taskrpc.RetryPolicy())
        await asyncio.gather(client.call(ask()), client.call(ask()))
    assert {b"a" * 25, b"b" * 25} == set(theirs.seen)
    assert len(theirs.seen) > 4


async def test_request_carries_the_first_span_of_several_observers():
    theirs, silent, first, second = Spans(), Spans(), Spans(b"1" * 25), Spans(b"2" * 25)
    observer = taskrpc.Observers(taskrpc.Observer(), silent, first, second)
    async with (
        taskrpc.Node("server", transport="memory", token="s", observer=theirs) as server,
        taskrpc.Node("client", transport="memory", token="c", observer=observer) as node,
    ):
        server.create_service(Add, "work", add)
        await node.create_client(Add, "work").call(ask())
    assert theirs.seen == [b"1" * 25]
    assert [silent.ends, first.ends, second.ends] == [[Code.OK]] * 3
