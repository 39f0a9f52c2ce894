"""A runaway caller hardly delays the others: frames, queues and unread output are bounded."""

import asyncio
import contextlib

import pytest

import taskrpc
from taskrpc.core.transport.connection.server_side import FRAMES_A_TURN
from taskrpc.core.transport.limits import backpressure
from taskrpc.core.wire.frames import LARGE, FrameType, pack_frame
from tests.core.transport.helpers import Add, Gate, Text, add, ask, outcome, until


@contextlib.asynccontextmanager
async def nodes(*names):
    """A server and callers, each as if in a program of its own."""
    async with contextlib.AsyncExitStack() as stack:
        made = [taskrpc.Node(name, transport="memory", token=name) for name in ("server", *names)]
        yield [await stack.enter_async_context(each) for each in made]


async def client_of(node, name="work", srv_type=Add):
    client = node.create_client(srv_type, name, timeout=None)
    assert await client.wait_for_service(60)
    return client


async def test_callers_take_turns_in_a_services_queue():
    order = []

    async def work(request, response):
        order.append(request.a)
        await asyncio.sleep(0.01)
        return response

    async with nodes("greedy", "modest") as (server, greedy, modest):
        server.create_service(Add, "work", work)
        many, one = await client_of(greedy), await client_of(modest)
        calls = [many.call_async(ask(n)) for n in range(200)]
        await until(lambda: len(order) == 3)
        place = len(order)
        await asyncio.gather(*[one.call(ask(1000 + n)) for n in range(3)])
        assert [n for n in order if n >= 1000] == [1000, 1001, 1002]
        assert len(order) <= place + 7, "each waited for one call of the other"
        await asyncio.gather(*calls)
        assert [n for n in order if n < 1000] == list(range(200))


async def test_calls_of_the_greediest_caller_are_refused_when_a_queue_is_full(monkeypatch):
    monkeypatch.setattr("taskrpc.service.QUEUE_LIMIT", 10)
    gate = Gate()
    async with nodes("greedy", "modest") as (server, greedy, modest):
        server.create_service(Add, "work", gate)
        many, one = await client_of(greedy), await client_of(modest)
        calls = [many.call_async(ask(n)) for n in range(50)]
        await asyncio.sleep(0.1)
        others = [one.call_async(ask(1000 + n)) for n in range(5)]
        await asyncio.sleep(0.1)
        gate.opened.set()
        assert [each.sum for each in await asyncio.gather(*others)] == list(range(1000, 1005))
        results = await asyncio.gather(*map(outcome, calls))
        refused = [each for each in results if isinstance(each, taskrpc.ServerBusy)]
        assert len(refused) == 50 - 1 - 10 + 5
        assert all(each.not_executed and each.retry_after > 0 for each in refused)
        assert sorted(gate.started) == [*range(6), *range(1000, 1005)]


async def test_other_callers_are_served_during_a_flood_of_frames():
    """One read may bring thousands of frames; other callers wait for a bounded number."""
    answered = []

    def note(request, response):
        answered.append(request.a)
        return response

    async with nodes("flooding", "modest") as (server, flooding, modest):
        server.create_service(Add, "work", note)
        flood, one = await client_of(flooding), await client_of(modest)
        await flood.call(ask()), await one.call(ask())
        connection, method = flood._channel._connection, flood._channel._method
        serving = [each for each in server._transport._served if each.caller == "/flooding"]
        answered.clear()
        first = connection.session.last_call_id + 1
        body = b"\x92\1\2"
        ids = range(first, first + 200)
        frames = [pack_frame(FrameType.REQUEST, 0, method, each, 9999, body) for each in ids]
        connection.session.open_calls.update(dict.fromkeys(ids, (None, 3)))
        connection.session.last_call_id = ids[-1]
        connection.transport.write(b"".join(frames))
        await one.call(ask(77))
        assert answered.index(77) <= 2 * FRAMES_A_TURN
        await until(lambda: len(answered) == 201)
        assert serving[0].transport.is_reading()
        assert (await flood.call(ask(1))).sum == 0


async def test_postponed_frames_are_handled_before_later_ones():
    order = []

    def note(request, response):
        order.append(request.a)
        return response

    async with nodes("flooding") as (server, flooding):
        server.create_service(Add, "work", note, concurrency=1)
        client = await client_of(flooding)
        for start in range(0, 1000, 200):
            calls = [client.call_async(ask(start + n)) for n in range(200)]
            await asyncio.gather(*calls)
        assert order == list(range(1000))


def big(request, response):
    response.message = "x" * (LARGE * 4)
    return response


async def test_calls_that_wait_for_a_caller_to_read_keep_their_order_and_delay_no_other_caller():
    begun = []

    async def large(request, response):
        begun.append(request.task_type)
        await asyncio.sleep(0.001)
        return big(request, response)

    async with nodes("lazy", "modest") as (server, lazy, modest):
        server.create_service(Text, "large", large)
        idle, one = await client_of(lazy, "large", Text), await client_of(modest, "large", Text)
        pipe = idle._channel._connection.transport
        pipe.pause_reading()
        calls = [idle.call_async(Text.Request(task_type=f"{n:03}")) for n in range(100)]
        await asyncio.sleep(1)
        assert begun == ["000"]
        for n in range(5):
            await one.call(Text.Request(task_type=f"other {n}"))
        assert begun == ["000", *[f"other {n}" for n in range(5)]]
        calls[50].cancel()
        pipe.resume_reading()
        await asyncio.gather(*calls[:50], *calls[51:])
        mine = [each for each in begun if "other" not in each]
        assert mine == [f"{n:03}" for n in range(100) if n != 50]


@pytest.mark.parametrize("concurrency", [1, 1000])
async def test_unread_responses_are_bounded_when_callers_never_read(monkeypatch, concurrency):
    monkeypatch.setattr(backpressure, "MAX_UNREAD", 10 * LARGE)
    async with nodes(*(f"lazy{n}" for n in range(30)), "modest") as (server, *lazy, modest):
        server.create_service(Text, "big", big, concurrency=concurrency)
        server.create_service(Add, "small", add)
        for each in lazy:
            client = await client_of(each, "big", Text)
            client._channel._connection.transport.pause_reading()
            client.call_async(Text.Request()).add_done_callback(lambda done: done.exception())
        await asyncio.sleep(0.5)

        def unread_bytes():
            served = server._transport._served
            return sum(each.transport.get_write_buffer_size() for each in served)

        assert 10 * LARGE <= unread_bytes() <= 15 * LARGE
        one = await client_of(modest, "small")
        assert (await one.call(ask(1))).sum == 1, "small responses are still sent"
        wanting = await client_of(modest, "big", Text)
        late = wanting.call_async(Text.Request())
        await asyncio.sleep(5)
        assert not late.done()
        assert unread_bytes() <= 15 * LARGE
        await until(late.done, 600)
        assert len(late.result().message) == 4 * LARGE
        await until(lambda: len(server._transport._served) == 1, 600)
        assert not unread_bytes()
        assert not server._transport.backpressure.is_active


async def test_resolve_requests_wait_while_their_responses_are_unread():
    """A listing may be long: a request of twenty bytes would cause megabytes of output."""
    async with nodes("lazy") as (server, lazy):
        for n in range(100):
            server.create_service(Add, f"service_with_a_long_name_{n}", add)
        client = await client_of(lazy, "service_with_a_long_name_0")
        connection = client._channel._connection
        connection.transport.pause_reading()
        question = lambda n: pack_frame(FrameType.RESOLVE, 0, 0, n, 0, b"\x91\xa0")  # noqa: E731
        connection.transport.write(b"".join(question(100 + n) for n in range(1000)))
        await asyncio.sleep(0.1)
        serving = next(iter(server._transport._served))
        assert serving.transport.get_write_buffer_size() < 500_000
        connection.session.open_calls.update({100 + n: (None, 0) for n in range(1000)})
        connection.session.last_call_id = 1100
        connection.transport.resume_reading()
        await until(lambda: not serving.session.in_flight)
        assert (await client.call(ask(1))).sum == 1
