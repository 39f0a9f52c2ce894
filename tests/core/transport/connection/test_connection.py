"""A connection pings silent peers and closes stalled ones; other peers are not affected."""

import asyncio
import logging
import struct
from collections import Counter
from itertools import pairwise

import pytest

import taskrpc
from taskrpc.core.transport.connection.connection import (
    HANDSHAKE_TIMEOUT,
    STALL_PERIOD,
    UNREAD_LIMIT,
    _Watch,
    shown,
)
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.transport.limits.keepalive import DEFAULT
from taskrpc.core.wire.events import Closed
from taskrpc.core.wire.frames import MAGIC, FrameType, pack_frame, pack_header
from taskrpc.core.wire.messages import Resolve
from tests.core.transport.helpers import Add, Gate, Text, add, ask, outcome, until


@pytest.fixture
async def server():
    async with taskrpc.Node("server", transport="memory", token="s") as node:
        node.create_service(Add, "add", add)
        yield node


@pytest.fixture
async def node():
    async with taskrpc.Node("client", transport="memory", token="c") as node:
        yield node


async def connected(node, name="add"):
    """A client and the two ends of its connection."""
    client = node.create_client(Add, name)
    assert await client.wait_for_service(60)
    return client, client._channel._connection


def frames_written(connection):
    types = []
    write = connection.transport.write

    def recorded(data):
        types.append(data[4])
        write(data)

    connection.transport.write = recorded
    return types


async def test_a_silent_peer_is_pinged_and_answers(server, node):
    client, connection = await connected(node)
    serving = next(iter(server._transport._served))
    asked, answered = frames_written(connection), frames_written(serving)
    await asyncio.sleep(DEFAULT.silence + 2.5)
    assert FrameType.PING in asked
    assert FrameType.PONG in answered
    assert len(asked) + len(answered) <= 8
    await asyncio.sleep(3600)
    assert connection.is_open
    assert (await client.call(ask(1))).sum == 1


async def test_no_ping_is_sent_while_calls_are_made(server, node):
    client, connection = await connected(node)
    asked = frames_written(connection)
    for _ in range(60):
        await asyncio.sleep(0.5)
        await client.call(ask())
    assert FrameType.PING not in asked


async def test_connection_of_a_peer_that_stalls_inside_a_frame_is_closed(server, node, caplog):
    client, _ = await connected(node)
    async with taskrpc.Node("lazy", transport="memory", token="z") as lazy:
        _, stalled = await connected(lazy)
        call = lazy.create_client(Add, "add").call_async(ask(), timeout=None)
        await call
        stalled.transport.write(pack_header(FrameType.REQUEST, 0, 1, 100, 0xFFFFFFFF, 5000)[:10])
        await asyncio.sleep(STALL_PERIOD - 2)
        assert stalled.is_open
        assert (await client.call(ask(1))).sum == 1
        await asyncio.sleep(4)
        assert not stalled.is_open
        assert (await client.call(ask(2))).sum == 2
    assert caplog.text.count("moved too few bytes") == 1


async def test_connection_of_a_peer_that_sends_below_the_rate_is_closed(server, node):
    _, stalled = await connected(node)
    stalled.transport.write(pack_header(FrameType.REQUEST, 0, 1, 100, 0xFFFFFFFF, 100_000))
    began = asyncio.get_running_loop().time()
    while stalled.is_open:
        stalled.transport.write(b"x" * 100)
        await asyncio.sleep(0.5)
    assert asyncio.get_running_loop().time() - began < 12.5


def test_bytes_that_the_kernel_buffered_do_not_count_as_read_by_the_peer():
    watch = _Watch(0.0)
    assert not watch.stalled(1.0, 0, owes=False)
    watch.written = 5_000_000
    assert not any(watch.stalled(2.0 + tick, 100_000, owes=True) for tick in range(9))
    assert watch.stalled(11.0, 100_000, owes=True)


async def test_slow_peer_above_the_rate_is_served(server, node, monkeypatch):
    client, slow = await connected(node)
    # A PING would interrupt the frame that we write.
    monkeypatch.setattr(type(slow.session), "ping", lambda self, nonce: None)
    body = b"\x92\x01\x02"
    slow.session.last_call_id += 1
    slow.session.open_calls[slow.session.last_call_id] = (None, 0)
    frame = pack_header(FrameType.REQUEST, 0, 1, slow.session.last_call_id, 0xFFFFFFFF, 100_000)
    frame += body + bytes(100_000 - len(body))
    for start in range(0, len(frame), 2000):
        slow.transport.write(frame[start : start + 2000])
        await asyncio.sleep(1)
    assert slow.is_open
    assert (await client.call(ask(1))).sum == 1


async def test_peer_that_reads_steadily_stays_connected_with_much_unread_output(server, node):
    def big(request, response):
        response.message = "x" * 400_000
        return response

    server.create_service(Text, "big", big)
    client = node.create_client(Text, "big", timeout=None)
    assert await client.wait_for_service(60)
    pipe = client._channel._connection.transport
    serving = next(iter(server._transport._served))
    pipe.pause_reading()
    calls = [client.call_async(Text.Request()) for _ in range(100)]
    await asyncio.sleep(0.1)
    for _ in range(60):
        # The peer reads 20 kB a second while more and more is written.
        taken = pipe._inbox.popleft()
        pipe._inbox_size -= len(taken)
        for start in range(0, len(taken), 20_000):
            pipe._inbox.appendleft(taken[start:])
            await asyncio.sleep(1)
            pipe._inbox.popleft()
        serving.transport.write(bytes(len(taken) + 1))
        if serving.transport is None:
            break
    else:
        assert serving.is_open
    for call in calls:
        call.cancel()


async def test_connection_of_a_caller_that_never_reads_is_closed(server, node, caplog):
    def big(request, response):
        response.message = "x" * (UNREAD_LIMIT + 1)
        return response

    server.create_service(Text, "big", big)
    client = node.create_client(Text, "big", timeout=None)
    assert await client.wait_for_service(60)
    client._channel._connection.transport.pause_reading()
    call = client.call_async(Text.Request())
    await asyncio.sleep(STALL_PERIOD + 2.5)
    assert "moved too few bytes" in caplog.text
    assert not server._transport._served
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)


async def test_connection_to_a_server_with_a_very_long_call_stays_open(server, node):
    server.create_service(Add, "gate", gate := Gate())
    client, connection = await connected(node, "gate")
    call = client.call_async(ask(), timeout=None)
    await asyncio.sleep(3600)
    assert connection.is_open
    gate.opened.set()
    await call


async def test_request_after_goaway_is_not_executed(server, node):
    """Request and GOAWAY crossed: the client sends the request to another server."""
    gate = Gate()
    server.create_service(Add, "gate", gate, concurrency=5)
    client, connection = await connected(node, "gate")
    call = client.call_async(ask(1))
    await until(lambda: gate.started)
    serving = next(iter(server._transport._served))
    serving.drain()
    late = client.call_async(ask(2))
    gate.opened.set()
    assert (await call).sum == 1
    await outcome(late)
    assert gate.started.count(2) == 1
    assert not connection.is_open


async def test_drained_connection_closes_after_its_last_response(server, node):
    gate = Gate()
    server.create_service(Add, "gate", gate)
    client, connection = await connected(node, "gate")
    call = client.call_async(ask(1))
    await until(lambda: gate.started)
    serving = next(iter(server._transport._served))
    serving.drain()
    await asyncio.sleep(5)
    assert connection.transport is not None
    gate.opened.set()
    assert (await call).sum == 1
    await asyncio.sleep(0)
    await asyncio.wait_for(asyncio.gather(connection.gone, serving.gone), 1)


async def test_connection_is_replaced_after_its_last_call_id(server, node, monkeypatch):
    monkeypatch.setattr("taskrpc.core.transport.connection.client_side.LAST_CALL_ID", 20)
    gate = Gate()
    server.create_service(Add, "gate", gate)
    client, first = await connected(node, "gate")
    held = client.call_async(ask(7), timeout=None)
    other = node.create_client(Add, "add")
    for n in range(100):
        assert (await other.call(ask(n))).sum == n
    assert client._channel._connection is first
    assert other._channel._connection is not first
    gate.opened.set()
    assert (await held).sum == 7
    await until(lambda: len(server._transport._served) == 1)
    assert first.transport is None


async def test_invalid_response_is_reported_as_one_error(server, node):
    server.create_service(Add, "gate", gate := Gate())
    client, _ = await connected(node, "gate")
    serving = next(iter(server._transport._served))
    for body in (b"", b"\x91\xa1x", b"\xc1", b"\x92\x01\x02"):
        call = client.call_async(ask())
        await until(lambda: serving.session.in_flight)
        (served,) = serving.session.open_tickets()
        serving.session.respond(served.call_id, body)
        serving.flush()
        error = await outcome(call)
        assert type(error) is taskrpc.TaskRpcError
        assert "the server's answer is not valid" in str(error)
        assert error.not_executed is False
        served.on_cancel()
        await until(lambda: not list(server._services)[-1]._jobs)
    assert len(gate.started) == 4


async def test_invalid_listing_is_reported_as_one_error(server, node, monkeypatch):
    _, connection = await connected(node)
    with monkeypatch.context() as patch:
        patch.setattr(server._transport, "listing", lambda: 42)
        error = await outcome(connection.resolve(Resolve(""), None).future)
    assert "the server's answer is not valid" in str(error)


async def test_invalid_bytes_after_the_magic_close_the_connection_with_one_log_line(server, caplog):
    class Stranger(asyncio.BufferedProtocol):
        def connection_made(self, transport):
            transport.write(MAGIC + struct.pack("<I", 0xFFFFFFFF) + bytes(30))

        def get_buffer(self, sizehint):
            return bytearray(1000)

        def buffer_updated(self, nbytes):
            pass

        def connection_lost(self, exc):
            lost.append(exc)

    lost = []
    network = server._transport.network
    address = network.locate("/add")[0]
    await network.dial(address, Stranger)
    await asyncio.sleep(0.1)
    assert lost == [None]
    assert [each.levelno for each in caplog.records] == [logging.WARNING]
    assert isinstance(server._transport, Endpoint)


async def test_forbidden_frames_close_only_their_own_connection(server, node, caplog):
    client, _ = await connected(node)
    for frame in (
        pack_frame(0x55, 0, 0, 0, 0),
        pack_frame(FrameType.RESPONSE, 0, 0, 99, 0, b"\x91\x01"),
        pack_frame(FrameType.REQUEST, 0, 1, 0, 0, b""),
        pack_frame(FrameType.RESOLVE, 0, 0, 50, 0, b"\xc1"),
    ):
        async with taskrpc.Node("bad", transport="memory", token="bad") as bad:
            _, connection = await connected(bad)
            connection.transport.write(frame)
            await asyncio.sleep(0.01)
            assert not connection.is_open
            assert (await client.call(ask(1))).sum == 1
    assert caplog.text.count("closed the connection from") == 4


async def test_cancel_in_the_same_read_as_its_request_cancels_the_call(server, node):
    """A busy server reads both at once; the callback must not run to its end."""
    gate = Gate()
    server.create_service(Add, "held", gate)
    client, connection = await connected(node, "held")
    request = pack_frame(FrameType.REQUEST, 0, client._channel._method, 50, 0xFFFFFFFF, b"\x92\1\2")
    serving = next(iter(server._transport._served))
    connection.transport.write(request + pack_frame(FrameType.CANCEL, 0, 0, 50, 0))
    await asyncio.sleep(0.1)
    assert gate.cancelled == [1]
    assert not serving.session.in_flight


async def test_client_above_the_limits_gets_its_responses_and_then_the_reason(
    server, node, monkeypatch, caplog
):
    gate = Gate()
    server.create_service(Add, "held", gate, concurrency=1000)
    client, connection = await connected(node, "held")
    calls = [client.call_async(ask(n)) for n in range(256)]
    await until(lambda: len(gate.started) == 256)
    told = []
    note = lambda _, event: told.append(str(event.error))  # noqa: E731
    monkeypatch.setitem(type(connection).handlers, Closed, note)
    monkeypatch.setattr(type(connection), "retire", lambda _: None)  # it ignores GOAWAY
    method = client._channel._method
    for call_id in range(1000, 1010):
        frame = pack_frame(FrameType.REQUEST, 0, method, call_id, 0xFFFFFFFF, b"\x92\1\2")
        connection.transport.write(frame)
    await asyncio.sleep(0.1)
    gate.opened.set()
    assert [each.sum for each in await asyncio.gather(*calls)] == list(range(256))
    await connection.gone
    assert told == ["more than 256 calls in flight on one connection"]
    assert len(gate.started) == 256
    lines = [each.message for each in caplog.records]
    assert len(lines) == 1
    assert (
        "exceeded its limits; its connection closes after the last response: more than 256 calls"
        in lines[0]
    )


async def test_ticks_of_thousands_of_connections_are_spread_over_time(server, monkeypatch):
    class Idle:
        def __init__(self):
            self.looks = []

        def tick(self, now):
            self.looks.append(now)

    endpoint = server._transport
    idle = [Idle() for _ in range(1000)]
    with monkeypatch.context() as patch:
        patch.setattr(endpoint, "_connections", lambda: idle)
        endpoint._tick()
        await asyncio.sleep(10.5)
    moments = Counter(look for each in idle for look in each.looks)
    assert max(moments.values()) <= 64
    for each in idle:
        assert 10 <= len(each.looks) <= 11
        assert max(late - early for early, late in pairwise(each.looks)) < 1.1


@pytest.mark.parametrize(
    ("peer", "text"),
    [
        (("127.0.0.1", 80), "127.0.0.1:80"),
        (("::1", 80, 0, 0), "::1:80"),
        ("/run/socket", "/run/socket"),
        (None, "a peer in memory"),
    ],
)
def test_address_of_a_peer_is_shown_as_users_write_it(peer, text):
    assert shown(peer) == text


class Leaver(asyncio.BufferedProtocol):
    """A peer that connects and writes `data`; the test closes its transport."""

    def __init__(self, data=b""):
        self.data = data

    def connection_made(self, transport):
        self.transport = transport
        transport.write(self.data)

    def get_buffer(self, sizehint):
        return bytearray(1000)

    def buffer_updated(self, nbytes):
        pass

    def connection_lost(self, exc):
        pass


async def test_peer_that_leaves_during_the_handshake_is_not_reported_later(server, caplog):
    network = server._transport.network
    stranger = await network.dial(network.locate("/add")[0], Leaver)
    await asyncio.sleep(0.5)
    (serving,) = server._transport._served
    stranger.transport.abort()
    await serving.gone
    await asyncio.sleep(HANDSHAKE_TIMEOUT + 1)
    assert not caplog.records


async def test_reason_for_which_a_connection_was_closed_is_logged_and_kept(server, node, caplog):
    _, connection = await connected(node)
    serving = next(iter(server._transport._served))
    connection.transport.write(pack_frame(0x55, 0, 0, 0, 0))
    await serving.gone
    reason = "frame type 85 is not part of this protocol"
    (record,) = caplog.records
    assert record.message.startswith("closed the connection from ")
    assert record.message.endswith(f": {reason}")
    assert str(serving.why_closed) == reason


async def test_ping_carries_the_number_of_bytes_received(server, node):
    _, connection = await connected(node)
    frames = []
    write = connection.transport.write
    connection.transport.write = lambda data: (frames.append(bytes(data)), write(data))
    received = connection.received
    await asyncio.sleep(DEFAULT.silence + 1.5)
    pings = [frame for frame in frames if frame[4] == FrameType.PING]
    assert pings[0] == pack_frame(FrameType.PING, 0, 0, 0, received)
    assert received > 0


async def test_bytes_that_another_thread_wrote_are_counted(node, server):
    _, connection = await connected(node)
    before = connection.written
    connection.count_written(100)
    assert connection.written == before + 100
