"""Each call ends exactly once, limits hold, and a peer can break only its own connection."""

import pytest

from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import (
    CancelReceived,
    Closed,
    Draining,
    ErrorReceived,
    LimitsExceeded,
    RequestReceived,
    ResolveReceived,
    ResponseReceived,
    ServicesChanged,
)
from taskrpc.core.wire.frames import HEADER, LARGE, NO_DEADLINE, FrameType, pack_frame
from taskrpc.core.wire.messages import Limits, Resolve
from taskrpc.core.wire.session import LONGEST_TIME, refused_error, unknown_error
from taskrpc.errors import (
    InvalidRequest,
    ProtocolError,
    ServerBusy,
    TaskRpcError,
)
from tests.core.wire.helpers import ConnectionPair, open_pair, receive

SIZE_OF_HEADER = HEADER.size

UNHEEDED = Limits(calls=10_000, bytes=10_000_000)
"""The limits that a client assumes if it ignores those of the server."""


def types(events):
    return [type(event) for event in events]


def frame(type_, call_id=0, arg=0, body=b"", flags=0, method=0):
    return pack_frame(type_, flags, method, call_id, arg, body)


@pytest.mark.parametrize("piece", [1, 5, 65_536])
def test_call_gets_its_response(piece):
    pair = open_pair()
    call_id = pair.client.request("ticket", 3, b"question", 250, flags=4)
    assert pair.client.in_flight == 1
    (asked,) = pair.deliver(pair.server, piece=piece)
    assert asked == RequestReceived(call_id, 3, 4, 250, b"question", 8)
    assert pair.server.in_flight == 1
    pair.server.respond(call_id, b"answer", 1234)
    (answered,) = pair.deliver(pair.client, piece=piece)
    assert answered == ResponseReceived("ticket", b"answer", 1234)
    assert pair.client.in_flight == pair.server.in_flight == 0


def test_a_thread_can_write_a_response_directly():
    pair = open_pair()
    call_id = pair.client.request("ticket", 3, b"question", NO_DEADLINE)
    pair.deliver(pair.server)
    frame, size = pair.server.pop_response(call_id, b"answer", LONGEST_TIME + 1)
    assert not pair.server.out
    assert receive(pair.client, frame) == [ResponseReceived("ticket", b"answer", LONGEST_TIME)]
    assert (size, pair.server.bytes_in_flight, pair.server.in_flight) == (8, 8, 0)
    pair.server.freed(size)
    assert pair.server.bytes_in_flight == 0
    assert pair.server.pop_response(call_id, b"again", 0) is None


def test_a_call_fails_with_the_servers_error():
    pair = open_pair()
    call_id = pair.client.request("ticket", 3, b"", NO_DEADLINE)
    pair.deliver(pair.server)
    pair.server.fail(call_id, ServerBusy("queue full", retry_after=0.5))
    (failed,) = pair.deliver(pair.client)
    assert failed.ticket == "ticket"
    assert type(failed.error) is ServerBusy
    assert failed.error.retry_after == pytest.approx(0.5)
    assert pair.client.in_flight == 0


@pytest.mark.parametrize("size", [LARGE - 1, LARGE, LARGE + 1, 300_000])
def test_large_bodies_arrive_in_any_pieces(size):
    pair = open_pair()
    body = bytes(range(251)) * (size // 251 + 1)
    call_id = pair.client.request("ticket", 1, body[:size], NO_DEADLINE)
    (asked,) = pair.deliver(pair.server, piece=40_000)
    assert asked.body == body[:size]
    pair.server.respond(call_id, asked.body)
    (answered,) = pair.deliver(pair.client, piece=70_001)
    assert answered.body == body[:size]


def test_the_largest_permitted_body_passes_and_one_byte_more_closes():
    pair = open_pair(limits=Limits(body=200_000))
    pair.client.request("fits", 1, bytes(200_000), NO_DEADLINE)
    assert types(pair.deliver(pair.server)) == [RequestReceived]
    pair.client.request("does not", 1, bytes(200_001), NO_DEADLINE)
    (closed,) = pair.deliver(pair.server)
    assert str(closed.error) == "a frame of 200001 bytes; at most 200000 are accepted"


def test_second_response_is_not_sent():
    pair = open_pair()
    call_id = pair.client.request("ticket", 1, b"", NO_DEADLINE)
    pair.deliver(pair.server)
    pair.server.respond(call_id, b"1")
    pair.server.respond(call_id, b"2")
    pair.server.fail(call_id, TaskRpcError("3"))
    assert [event.body for event in pair.deliver(pair.client)] == [b"1"]


def test_a_cancelled_call_keeps_its_place_until_its_terminal_frame():
    pair = open_pair(limits=Limits(calls=1))
    call_id = pair.client.request("ticket", 1, b"", NO_DEADLINE)
    (request,) = pair.deliver(pair.server)
    pair.client.cancel(call_id)
    pair.client.cancel(call_id)
    assert not pair.client.request("no room", 1, b"", NO_DEADLINE)
    assert pair.deliver(pair.server) == [CancelReceived(call_id, request)]
    pair.server.respond(call_id, b"too late")
    assert pair.deliver(pair.client) == []
    assert pair.client.request("room", 1, b"", NO_DEADLINE)


def test_a_stopped_call_still_gets_its_response_until_it_is_dropped():
    pair = open_pair()
    kept, dropped = (pair.client.request(name, 1, b"", NO_DEADLINE) for name in ("a", "b"))
    pair.deliver(pair.server)
    for call_id in (kept, dropped):
        pair.client.ask_to_stop(call_id)
    pair.client.drop(dropped)
    assert [event.call_id for event in pair.deliver(pair.server)] == [kept, dropped]
    for call_id in (kept, dropped):
        pair.server.fail(call_id, TaskRpcError("cancelled by the caller", not_executed=True))
    (failed,) = pair.deliver(pair.client)
    assert (failed.ticket, failed.error.not_executed) == ("a", True)
    pair.client.ask_to_stop(kept)
    pair.client.drop(kept)
    assert pair.deliver(pair.server) == []


def test_the_server_time_is_capped_at_the_largest_value_of_a_frame():
    pair = open_pair()
    call_id = pair.client.request("ticket", 1, b"", NO_DEADLINE)
    pair.deliver(pair.server)
    pair.server.respond(call_id, b"", LONGEST_TIME + 1)
    assert [event.server_time for event in pair.deliver(pair.client)] == [LONGEST_TIME]


def test_cancel_that_crosses_the_response_is_ignored():
    pair = open_pair()
    call_id = pair.client.request("ticket", 1, b"", NO_DEADLINE)
    pair.deliver(pair.server)
    pair.server.respond(call_id, b"")
    pair.client.cancel(call_id)
    assert pair.deliver(pair.server) == []
    assert pair.deliver(pair.client) == []
    assert pair.client.lost() == []


def test_resolve_gets_a_response_like_a_call():
    pair = open_pair()
    call_id = pair.client.resolve("ticket", Resolve("/x", "hash"), definition=True)
    assert pair.deliver(pair.server) == [ResolveReceived(call_id, Resolve("/x", "hash"), True, 10)]
    pair.server.fail(call_id, InvalidRequest("name", "no such"))
    (failed,) = pair.deliver(pair.client)
    assert failed.error.path == "name"


def test_resolve_requests_do_not_count_against_the_limit_of_calls():
    pair = open_pair(limits=Limits(calls=2))
    for n in range(2):
        pair.client.request(n, 1, b"", NO_DEADLINE)
    for n in range(20):
        pair.client.resolve(n, Resolve(f"/service_{n}"))
    events = pair.deliver(pair.server)
    assert types(events) == [RequestReceived] * 2 + [ResolveReceived] * 20
    assert pair.server.state is ConnectionState.OPEN


def test_client_with_too_many_calls_gets_its_responses_and_the_reason():
    pair = open_pair(limits=Limits(calls=2))
    pair.client.their_limits = UNHEEDED
    ids = [pair.client.request(n, 1, b"", NO_DEADLINE) for n in range(5)]
    *two, overrun = pair.deliver(pair.server)
    assert types(two) == [RequestReceived] * 2
    assert str(overrun.error) == "more than 2 calls in flight on one connection"
    assert pair.deliver(pair.client) == [Draining([2, 3, 4])]
    for call_id in ids[:2]:
        pair.server.respond(call_id, b"")
    assert types(pair.deliver(pair.client)) == [ResponseReceived] * 2
    pair.server.reject(overrun.error)
    (closed,) = pair.deliver(pair.client)
    assert str(closed.error) == str(overrun.error)


def test_requests_over_the_limits_after_goaway_are_ignored():
    pair = open_pair(limits=Limits(calls=2))
    pair.client.their_limits = UNHEEDED
    for n in range(1000):
        pair.client.request(n, 1, b"", NO_DEADLINE)
    assert types(pair.deliver(pair.server)) == [RequestReceived] * 2 + [LimitsExceeded]
    assert pair.server.in_flight == 2
    assert len(b"".join(pair.server.out)) == SIZE_OF_HEADER


def test_client_with_too_many_bytes_gets_the_reason():
    pair = open_pair(limits=Limits(bytes=100))
    pair.client.request("alone it may be larger", 1, bytes(500), NO_DEADLINE)
    assert not pair.client.request("no room", 1, b"", NO_DEADLINE)
    pair.client.their_limits = UNHEEDED
    pair.client.request("too much", 1, b"", NO_DEADLINE)
    *_, overrun = pair.deliver(pair.server)
    assert isinstance(overrun, LimitsExceeded)
    assert str(overrun.error) == "more than 100 bytes in flight on one connection"


def test_one_body_above_the_bytes_in_flight_is_sent_alone():
    pair = open_pair(limits=Limits(bytes=100))
    call_id = pair.client.request("large", 1, bytes(5000), NO_DEADLINE)
    assert types(pair.deliver(pair.server)) == [RequestReceived]
    pair.server.respond(call_id, b"")
    pair.deliver(pair.client)
    assert pair.client.request("room", 1, bytes(100), NO_DEADLINE)


def test_advertise_becomes_an_event_of_the_client():
    pair = open_pair()
    pair.server.advertise()
    assert types(pair.deliver(pair.client)) == [ServicesChanged]


# Drain


def test_a_draining_server_finishes_its_calls():
    pair = open_pair()
    call_id = pair.client.request("ticket", 1, b"", NO_DEADLINE)
    pair.deliver(pair.server)
    pair.server.drain()
    pair.server.drain()
    assert pair.deliver(pair.client) == [Draining([])]
    assert not pair.client.request("no room", 1, b"", NO_DEADLINE)
    pair.server.respond(call_id, b"done")
    assert pair.deliver(pair.client) == [ResponseReceived("ticket", b"done", 0)]


@pytest.mark.parametrize("question", [False, True])
def test_call_that_crosses_goaway_is_not_executed_and_is_reported_as_refused(question):
    pair = open_pair()
    first = pair.client.request("first", 1, b"", NO_DEADLINE)
    pair.deliver(pair.server)
    pair.server.drain()
    if question:
        pair.client.resolve("crossing", Resolve("/x"))
    else:
        pair.client.request("crossing", 1, b"", NO_DEADLINE)
    assert pair.deliver(pair.server) == []
    assert pair.server.in_flight == 1
    assert pair.deliver(pair.client) == [Draining(["crossing"])]
    pair.server.respond(first, b"")
    assert types(pair.run()[0]) == [ResponseReceived]
    assert pair.client.state is ConnectionState.DRAINING
    assert pair.client.lost() == []
    assert refused_error().not_executed is True


def test_a_cancelled_call_that_crosses_goaway_is_not_reported():
    pair = open_pair()
    pair.server.drain()
    call_id = pair.client.request("gone", 1, b"", NO_DEADLINE)
    pair.client.cancel(call_id)
    assert pair.run() == ([Draining([])], [])
    assert pair.client.in_flight == 0


def test_only_a_server_drains():
    pair = open_pair()
    (closed,) = receive(pair.server, frame(FrameType.GOAWAY))
    assert str(closed.error) == "a client may not send frame type 13"


def test_drain_before_the_handshake_sends_nothing():
    pair = ConnectionPair()
    pair.deliver(pair.server)
    pair.server.take()
    pair.server.drain()
    pair.server.advertise()
    assert not pair.server.out
    assert pair.server.state is ConnectionState.HANDSHAKE


# Ends


def test_lost_returns_every_open_ticket_once():
    pair = open_pair()
    ids = [pair.client.request(n, 1, b"", NO_DEADLINE) for n in range(4)]
    pair.deliver(pair.server)
    pair.server.respond(ids[0], b"")
    pair.deliver(pair.client)
    pair.client.cancel(ids[1])
    assert pair.client.lost() == [2, 3]
    assert unknown_error().not_executed is None
    assert pair.client.lost() == []
    assert pair.client.in_flight == 0


def question(call_id=1, body=b"\x91\xa0"):
    return frame(FrameType.RESOLVE, call_id, body=body)


OFFENCES_OF_A_CLIENT = {
    "a response to nothing": (frame(FrameType.RESPONSE, 1), "a response to call 1, which is not"),
    "an error to nothing": (frame(FrameType.ERROR, 5), "a response to call 5, which is not"),
    "call id 0": (frame(FrameType.REQUEST, 0), "call id 0 follows 0"),
    "a used call id": (frame(FrameType.REQUEST, 4) * 2, "call id 4 follows 4"),
    "a smaller call id": (frame(FrameType.REQUEST, 4) + question(3), "call id 3"),
    "an unknown type": (frame(0x7F), "frame type 127 is not part of this protocol"),
    "type 0": (frame(0), "frame type 0 is not part of this protocol"),
    "a second greeting": (frame(FrameType.HELLO), "frame type 1 is not part of this protocol"),
    "an advertisement": (frame(FrameType.ADVERTISE), "a client may not send frame type 5"),
    "a question that is none": (question(body=b"?"), "Resolve is not valid: "),
    "a question not in UTF-8": (question(body=b"\x91\xa1\xff"), "Resolve is not"),
    "a question too deep": (question(body=b"\x93\xa0\xa0" + b"\x91" * 10**5), "Resolve is not"),
    "a length of nothing": (bytes(16), "a frame's length is 0, shorter than its own header"),
}


@pytest.mark.parametrize("name", OFFENCES_OF_A_CLIENT)
def test_protocol_violation_closes_the_connection_with_its_reason(name):
    stream, sentence = OFFENCES_OF_A_CLIENT[name]
    pair = open_pair()
    *_, closed = receive(pair.server, stream)
    assert type(closed) is Closed
    assert type(closed.error) is ProtocolError
    assert str(closed.error).startswith(sentence)


@pytest.mark.parametrize("type_", [FrameType.REQUEST, FrameType.RESOLVE])
def test_a_server_may_not_call(type_):
    pair = open_pair()
    (closed,) = receive(pair.client, frame(type_, 1, body=b"\x91\xa0"))
    assert str(closed.error) == "a server may not call"


# Garbage


def test_frames_of_a_server_have_no_flags_and_the_documented_fields():
    pair = open_pair()
    first, second = (pair.client.request(n, 3, b"question", 250) for n in range(2))
    pair.deliver(pair.server)
    server = pair.server
    assert server.respond(first, b"answer", 7)
    assert b"".join(server.take()) == frame(FrameType.RESPONSE, first, 7, b"answer")
    assert server.pop_response(second, b"other", 8) == (
        frame(FrameType.RESPONSE, second, 8, b"other"),
        len(b"question"),
    )
    server.freed(len(b"question"))
    assert server.bytes_in_flight == 0
    server.advertise()
    server.drain()
    end = frame(FrameType.ADVERTISE) + frame(FrameType.GOAWAY, arg=second)
    assert b"".join(server.take()) == end


def test_call_can_fail_only_once():
    pair = open_pair()
    call_id = pair.client.request("ticket", 3, b"question", 250)
    pair.deliver(pair.server)
    assert pair.server.fail(call_id, TaskRpcError("no"))
    assert not pair.server.fail(call_id, TaskRpcError("no"))
    assert types(pair.deliver(pair.client)) == [ErrorReceived]
