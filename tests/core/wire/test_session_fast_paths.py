"""A session packs and splits the frames of small calls by shorter ways, with the same effects."""

import struct

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from taskrpc.core.wire.events import ResponseReceived
from taskrpc.core.wire.frames import HEADER, LARGE, NO_DEADLINE, FrameType, pack_frame
from taskrpc.core.wire.session import LONGEST_TIME, Session
from tests.core.wire.helpers import Replaced, open_pair, receive
from tests.properties import examples

SIZE_OF_HEADER = HEADER.size


def frame(type_, call_id=0, arg=0, body=b"", flags=0, method=0):
    return pack_frame(type_, flags, method, call_id, arg, body)


hostile_frame = st.builds(
    pack_frame,
    st.one_of(st.integers(1, 17), st.integers(0, 255)),
    st.integers(0, 255),
    st.integers(0, 0xFFFF),
    st.one_of(st.integers(0, 6), st.integers(0, 0xFFFFFFFF)),
    st.one_of(st.integers(0, 6), st.integers(0, 0xFFFFFFFF)),
    st.one_of(st.just(b""), st.binary(max_size=60), st.just(b"\x92\xa1x\xa0")),
)


near_large = st.one_of(st.integers(0, 40), st.integers(LARGE - 2, LARGE + 2))
a_request = st.tuples(
    st.integers(0, 0xFFFF), near_large, st.integers(0, NO_DEADLINE), st.integers(0, 255)
)


server_times = st.one_of(
    st.integers(0, 9), st.integers(LONGEST_TIME, LONGEST_TIME + 9), st.integers(0, 2**40)
)


@given(st.lists(a_request, min_size=1, max_size=4), server_times, st.booleans())
@settings(max_examples=examples(60))
def test_requests_and_responses_are_the_same_frames_as_from_send(requests, server_time, beside):
    pair, plain = open_pair(), open_pair()
    for call_id, (method, size, left, flags) in enumerate(requests, 1):
        assert pair.client.request("ticket", method, bytes(size), left, flags) == call_id
        plain.client.send(FrameType.REQUEST, flags, method, call_id, left, bytes(size))
    sent = pair.client.take()
    assert sent == plain.client.take()
    receive(pair.server, b"".join(sent))
    for call_id, (_, size, _, _) in enumerate(requests, 1):
        if beside and size < LARGE:
            answer, freed = pair.server.pop_response(call_id, bytes(size), server_time)
            pair.server.freed(freed)
            pair.server.out.append(answer)
        else:
            assert pair.server.respond(call_id, bytes(size), server_time)
        time = min(server_time, LONGEST_TIME)
        plain.server.send(FrameType.RESPONSE, 0, 0, call_id, time, bytes(size))
    assert pair.server.take() == plain.server.take()
    assert (pair.server.open_calls, pair.server.bytes_in_flight) == ({}, 0)


def state_of(end):
    calls = {call_id: repr(each) for call_id, each in end.open_calls.items()}
    return end.state, calls, end.bytes_in_flight, end.last_call_id, b"".join(end.take())


LIMIT = 50
long_body = st.integers(LIMIT - 2, LIMIT + 2).map(bytes)
inner_frame = st.sampled_from([frame(FrameType.PING, arg=1), frame(FrameType.RESPONSE, 1)])
some_frame = st.one_of(
    hostile_frame, st.builds(frame, st.integers(0, 255), body=st.one_of(long_body, inner_frame))
)
"""Also frames at the size limit, and frames that contain a whole frame as their body."""


@given(st.lists(some_frame, max_size=8), st.data(), st.booleans(), st.booleans())
@settings(max_examples=examples(150))
def test_frame_in_one_read_has_the_same_effects_as_in_two_pieces(stream, data, is_client, drains):
    ends = []
    for pair in (open_pair(), open_pair()):
        for n in range(3):
            pair.client.request(n, 1, b"", 100)
        end = pair.client if is_client else pair.server
        if drains:
            pair.server.drain()
            pair.deliver(pair.client)
        end.splitter.limit = LIMIT
        ends.append(end)
    whole, cut = ends
    for each in stream:
        behind_header = min(SIZE_OF_HEADER, len(each) - 1)
        middle = data.draw(st.one_of(st.just(behind_header), st.integers(1, len(each) - 1)))
        events = list(whole.feed(each))
        assert repr(events) == repr([*cut.feed(each[:middle]), *cut.feed(each[middle:])])
        assert state_of(whole) == state_of(cut)


response = st.builds(
    frame,
    st.just(FrameType.RESPONSE),
    st.integers(1, 5),
    st.integers(0, 9),
    st.one_of(st.binary(max_size=9), long_body),
)
reads = st.lists(st.lists(st.one_of(response, response, some_frame), max_size=5), max_size=4)


cuts = st.lists(st.integers(1, 40), max_size=6)


@given(reads, cuts, st.booleans())
@settings(max_examples=examples(200))
def test_responses_of_a_read_have_the_same_effects_as_their_events(reads, cuts, drains):
    compare_responses(reads, list(cuts), drains)


@pytest.mark.faults
@pytest.mark.parametrize(
    ("text", "by"),
    [
        ("self.state is not _OPEN or ", ""),
        ("end - body > splitter.limit", "False"),
        ("type_ != _RESPONSE", "False"),
        ("call_id not in open_calls", "False"),
        ("del open_calls[call_id]", "pass"),
        ("self.bytes_in_flight -= request_size", "pass"),
        ("if ticket is not None:", "if True:"),
        ("data = splitter.take_tail() + data", "splitter.take_tail()"),
        ("data[start:]", "b''"),
    ],
)
def test_a_difference_between_responses_and_events_is_found(text, by):
    @given(reads, cuts, st.booleans())
    @settings(max_examples=500, database=None, derandomize=True, phases=[Phase.generate])
    def compare(reads, cuts, drains):
        try:
            compare_responses(reads, list(cuts), drains)
        except (KeyError, struct.error) as error:  # the difference itself fails
            raise AssertionError from error

    with Replaced(Session, "responses", text, by).patch, pytest.raises(AssertionError):
        compare()


def compare_responses(reads, cuts, drains):
    ends = []
    for pair in (open_pair(), open_pair()):
        for number in range(4):
            pair.client.request(f"ticket {number}", 1, bytes(number), 100)
        pair.client.cancel(2)
        if drains:
            pair.server.drain()
            pair.deliver(pair.client)
        pair.client.splitter.limit = LIMIT
        ends.append(pair.client)
    plain, general = ends
    stream = b"".join(each for read in reads for each in read)
    while stream:
        count = cuts.pop() if cuts else len(stream)
        data, stream = stream[:count], stream[count:]
        found, rest = plain.responses(data, len(data))
        events = [(ticket, bytes(body)) for ticket, body in found]
        events += [noted(event) for event in (plain.feed(rest) if rest else ())]
        assert events == [noted(event) for event in general.feed(data)]
        assert state_of(plain) == state_of(general)
        assert plain.splitter.tail == general.splitter.tail


def noted(event):
    """What a client does with an event, for comparison."""
    if isinstance(event, ResponseReceived):
        return event.ticket, bytes(event.body)
    return repr(event)
