"""The base of a session: frames, pings, the end, and errors of the peer."""

import gc
import tracemalloc
from collections import Counter
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import (
    Closed,
    Event,
    ResponseReceived,
)
from taskrpc.core.wire.frames import LARGE, NO_DEADLINE, FrameType, pack_frame, pack_header
from taskrpc.core.wire.messages import DEFAULT_LIMITS, Resolve
from taskrpc.errors import (
    InvalidRequest,
    TaskRpcError,
)
from tests.core.wire.helpers import ConnectionPair, open_pair, receive
from tests.properties import examples

DOCUMENTED = get_args(Event)


def types(events):
    return [type(event) for event in events]


def frame(type_, call_id=0, arg=0, body=b"", flags=0, method=0):
    return pack_frame(type_, flags, method, call_id, arg, body)


def test_a_ping_is_answered_without_an_event():
    pair = open_pair()
    pair.client.ping(99)
    assert pair.deliver(pair.server) == []
    assert pair.server.out, "the answer"
    assert pair.deliver(pair.client) == []
    assert not pair.client.out


@pytest.mark.parametrize("offence", [frame(0x7F), bytes(16), frame(FrameType.RESPONSE, 1)])
def test_a_protocol_error_is_sent_to_the_peer(offence):
    pair = open_pair()
    (closed,) = receive(pair.server, offence)
    (told,) = pair.deliver(pair.client)
    assert str(told.error) == str(closed.error)
    assert not pair.server.take()


def test_session_keeps_no_bytes_of_the_handshake():
    """A server may have thousands of idle connections."""
    pair = open_pair()
    kept = [each for each in gc.get_referents(pair.server) if isinstance(each, bytes)]
    assert not any(kept)


def test_a_peer_without_the_magic_bytes_gets_no_reply():
    pair = ConnectionPair()
    assert types(receive(pair.server, b"GET / HTTP/1.1")) == [Closed]
    assert not pair.server.take()


def test_ended_session_ignores_input_and_sends_nothing():
    pair = open_pair()
    call_id = pair.client.request("ticket", 1, b"", NO_DEADLINE)
    pair.deliver(pair.server)
    pair.server.respond(call_id, b"")
    late = b"".join(pair.server.take())
    pair.client.lost()
    assert not list(pair.client.feed(late))
    pair.server.lost()
    pair.server.respond(call_id, b"")
    pair.server.fail(call_id, TaskRpcError("late"))
    assert not pair.server.out


def test_closed_session_ignores_a_large_body():
    pair = open_pair()
    receive(pair.server, frame(FrameType.REQUEST, 1) + frame(FrameType.REQUEST, 1))
    receive(pair.client, pack_header(FrameType.RESPONSE, 0, 0, 1, 0, 2 * LARGE))
    assert pair.client.splitter.large is not None
    pair.client.lost()
    assert not list(pair.client.filled(10))


@pytest.mark.parametrize(
    "bad",
    [
        frame(FrameType.ERROR, body=b"\x91\xa3bye"),
        frame(FrameType.RESPONSE, 77),
        frame(0x7F),
        bytes(16),
        frame(FrameType.RESPONSE, 1) * 2,
    ],
)
def test_frames_before_a_protocol_error_are_handled_and_none_after_it(bad):
    for piece in (1, 65_536):
        pair = open_pair()
        for ticket in "ab":
            pair.client.request(ticket, 1, b"", NO_DEADLINE)
        stream = frame(FrameType.RESPONSE, 2) + bad + frame(FrameType.ADVERTISE)
        events = receive(pair.client, stream, piece)
        assert events[0] == ResponseReceived("b", b"", 0)
        assert types(events[1:]) in ([Closed], [ResponseReceived, Closed])
        assert pair.client.state is ConnectionState.CLOSED
        assert len(pair.client.lost()) == 2 - types(events).count(ResponseReceived)


HANDSHAKE = {FrameType.HELLO, FrameType.HELLO_ACK, FrameType.AUTH, FrameType.AUTH_OK}


@pytest.mark.parametrize("type_", sorted(set(FrameType) - HANDSHAKE))
def test_each_frame_type_is_known_to_one_end_at_least(type_):
    pair = open_pair()
    unknown = f"frame type {int(type_)} is not part of this protocol"
    ends = [receive(end, frame(type_, 1)) for end in (pair.client, pair.server)]
    refused = [any(unknown in str(getattr(each, "error", "")) for each in end) for end in ends]
    assert not all(refused), "handle it in Session._event, Session._on_control or topics.received"


@pytest.mark.parametrize("type_", [0x80, 0xFF])
def test_unknown_optional_frames_are_ignored(type_):
    pair = open_pair()
    for end in (pair.client, pair.server):
        assert receive(end, frame(type_, 9, 9, b"later version")) == []
        assert end.state is ConnectionState.OPEN


def test_error_frame_for_the_connection_closes_it_with_its_reason():
    pair = open_pair()
    pair.client.request("ticket", 1, b"", NO_DEADLINE)
    (closed,) = receive(pair.client, frame(FrameType.ERROR, arg=7 << 16, body=b"\x91\xa2no"))
    assert type(closed) is Closed
    assert str(closed.error) == "no"
    assert pair.client.lost() == ["ticket"]


def conversation():
    """The bytes that a client and a server send each other, with many kinds of frames."""
    pair = open_pair()
    for n in range(3):
        pair.client.request(n, 1, bytes(n * 10), 100)
    pair.client.resolve("r", Resolve("/x"))
    pair.client.cancel(2)
    pair.client.ping(1)
    pair.collect()
    to_server = bytes(pair.wire[pair.server])
    pair.deliver(pair.server)
    pair.server.respond(1, b"one")
    pair.server.fail(2, InvalidRequest("a.b", "no"))
    pair.server.advertise()
    pair.server.respond(3, b"three")
    pair.server.drain()
    pair.collect()
    return to_server, bytes(pair.wire[pair.client])


def hear(end, stream, piece):
    """Feed a session the bytes of a hostile peer; only documented events may result."""
    events = receive(end, stream, piece)
    assert all(isinstance(event, DOCUMENTED) for event in events)
    assert types(events).count(Closed) == (end.state is ConnectionState.CLOSED)
    assert not events or Closed not in types(events[:-1])
    assert all(isinstance(event.error, TaskRpcError) for event in events if type(event) is Closed)
    return events


@given(st.data(), st.integers(1, 200))
@settings(max_examples=examples(150))
def test_changed_frames_end_one_connection_and_raise_nothing(data, piece):
    pair = open_pair()
    to_server, to_client = conversation()
    for n in range(3):
        pair.client.request(n, 1, b"", 100)
    pair.client.resolve("r", Resolve("/x"))
    for end, stream in ((pair.server, to_server), (pair.client, to_client)):
        changed = bytearray(stream)
        for _ in range(data.draw(st.integers(1, 3))):
            changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
        hear(end, bytes(changed), piece)
    told = pair.client.lost()
    assert max(Counter(told).values(), default=1) == 1


hostile_frame = st.builds(
    pack_frame,
    st.one_of(st.integers(1, max(FrameType) + 1), st.integers(0, 255)),
    st.integers(0, 255),
    st.integers(0, 0xFFFF),
    st.one_of(st.integers(0, 6), st.integers(0, 0xFFFFFFFF)),
    st.one_of(st.integers(0, 6), st.integers(0, 0xFFFFFFFF)),
    st.one_of(st.just(b""), st.binary(max_size=60), st.just(b"\x92\xa1x\xa0")),
)


@given(st.lists(hostile_frame, max_size=12), st.integers(1, 300), st.booleans())
@settings(max_examples=examples(150))
def test_frames_with_random_content_raise_nothing(stream, piece, is_client):
    pair = open_pair()
    for n in range(3):
        pair.client.request(n, 1, b"", 100)
    end = pair.client if is_client else pair.server
    hear(end, b"".join(stream), piece)
    assert pair.server.in_flight <= DEFAULT_LIMITS.calls + 12


def test_announced_large_bodies_allocate_no_memory():
    tracemalloc.start()
    try:
        pairs = [open_pair() for _ in range(30)]
        for pair in pairs:
            header = pack_header(FrameType.REQUEST, 0, 1, 1, 0, DEFAULT_LIMITS.body)
            assert receive(pair.server, header) == []
            assert pair.server.mid_frame
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 30 * 2 * LARGE


def test_pings_of_a_peer_that_does_not_read_are_not_answered():
    pair = open_pair()
    pair.client.answers_pings = False
    assert not list(pair.client.feed(frame(FrameType.PING, arg=7) * 1000))
    assert pair.client.take() == []
    pair.client.answers_pings = True
    list(pair.client.feed(frame(FrameType.PING, arg=8)))
    assert b"".join(pair.client.take()) == frame(FrameType.PONG, arg=8)
