"""The splitter returns the frames that were sent, in any pieces; false lengths take no memory."""

import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.core.wire import frames
from taskrpc.core.wire.frames import (
    FIRST_OPTIONAL_TYPE,
    GROWTH,
    LARGE,
    SKIPPED,
    FrameType,
    Splitter,
    pack_frame,
    pack_header,
)
from taskrpc.errors import ProtocolError
from tests.properties import examples

LIMIT = 16 * 1024 * 1024 + 65_536

SMALL = (FrameType.REQUEST, 1, 7, 42, 1000, b"abc")
EMPTY = (FrameType.PING, 0, 0, 0, 0xFFFFFFFF, b"")
EDGE = (FrameType.RESPONSE, 255, 0xFFFF, 0xFFFFFFFF, 0, bytes(LARGE - 1))
BIG = (0xFF, 0, 0, 1, 2, bytes(range(256)) * (LARGE // 256))
HUGE = (FrameType.REQUEST, 0, 1, 3, 0, b"0123456789abcdef" * (5 * LARGE // 16 + 1))
CASES = {
    "nothing": [],
    "one": [SMALL],
    "no body": [EMPTY],
    "several": [SMALL, EMPTY, SMALL],
    "almost large": [EDGE, SMALL],
    "just large": [SMALL, BIG, SMALL],
    "large after large": [HUGE, BIG, EMPTY],
}


def packed(all_frames):
    return b"".join(pack_frame(*frame) for frame in all_frames)


def room_of(splitter):
    return None if splitter.large is None else splitter.large.room()


def split(splitter, stream, cuts=(), *, use_room=True):
    """Every frame of a stream that arrives in pieces, read as a transport reads."""
    found = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        piece = stream[start:end]
        while piece and use_room and (room := room_of(splitter)) is not None:
            count = min(len(room), len(piece))
            room[:count] = piece[:count]
            found += splitter.filled(count)
            piece = piece[count:]
        found += splitter.feed(piece)
    return found


@pytest.mark.parametrize("use_room", [True, False])
@pytest.mark.parametrize("name", CASES)
def test_a_whole_stream_yields_its_frames(name, use_room):
    splitter = Splitter(LIMIT)
    assert split(splitter, packed(CASES[name]), use_room=use_room) == CASES[name]
    assert not splitter.mid_frame
    assert splitter.error is None


@pytest.mark.parametrize("name", ["one", "no body", "several"])
def test_a_stream_byte_by_byte_yields_the_same_frames(name):
    stream = packed(CASES[name])
    assert split(Splitter(LIMIT), stream, range(1, len(stream))) == CASES[name]


@pytest.mark.parametrize("tail", [1, 4, 15, 16, 18])
@pytest.mark.parametrize("name", CASES)
def test_a_tail_waits_for_its_rest(name, tail):
    splitter = Splitter(LIMIT)
    more = pack_frame(*SMALL)
    assert split(splitter, packed(CASES[name]) + more[:tail]) == CASES[name]
    assert splitter.mid_frame
    assert split(splitter, more[tail:]) == [SMALL]
    assert not splitter.mid_frame


a_frame = st.tuples(
    st.integers(0, 255),
    st.integers(0, 255),
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFFFFFFFF),
    st.integers(0, 0xFFFFFFFF),
    st.one_of(st.binary(max_size=40), st.integers(0, 4 * LARGE).map(lambda size: b"\xa5" * size)),
)


@given(st.data(), st.lists(a_frame, max_size=5), st.booleans())
@settings(max_examples=examples(150))
def test_the_cuts_of_the_stream_make_no_difference(data, all_frames, use_room):
    stream = packed(all_frames)
    cut = st.integers(0, len(stream))
    cuts = sorted(data.draw(st.lists(cut, max_size=12)))
    assert split(Splitter(LIMIT), stream, cuts, use_room=use_room) == all_frames


def test_header_and_body_apart_are_the_same_frame():
    body = b"x" * 10
    assert pack_header(7, 1, 2, 3, 4, len(body)) + body == pack_frame(7, 1, 2, 3, 4, body)


def test_the_layout_is_the_documented_one():
    assert pack_frame(FrameType.REQUEST, 2, 0x0304, 5, 6, b"!") == bytes.fromhex(
        "0d000000 07 02 0403 05000000 06000000 21"
    )
    assert frames.HEADER.size == 16


@pytest.mark.parametrize("length", [0, 1, 11])
def test_a_length_shorter_than_the_header_is_an_error(length):
    splitter = Splitter(LIMIT)
    assert splitter.feed(length.to_bytes(4, "little") + bytes(12)) == []
    assert isinstance(splitter.error, ProtocolError)
    assert str(splitter.error) == f"a frame's length is {length}, shorter than its own header"


def test_the_limit_is_the_largest_body():
    splitter = Splitter(100)
    assert len(splitter.feed(pack_frame(7, 0, 0, 1, 0, bytes(100)))) == 1
    assert splitter.error is None
    assert splitter.feed(pack_frame(7, 0, 0, 1, 0, bytes(101))) == []
    assert str(splitter.error) == "a frame of 101 bytes; at most 100 are accepted"


@given(st.data(), st.lists(a_frame, max_size=3))
@settings(max_examples=examples(60))
def test_frames_before_a_bad_length_are_returned_under_every_cut(data, all_frames):
    stream = packed(all_frames) + b"\x00" * 16 + packed([SMALL])
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream) - 32), max_size=6)))
    splitter = Splitter(LIMIT)
    assert split(splitter, stream, cuts) == all_frames
    assert splitter.error is not None


def test_a_limit_raised_in_time_lets_the_waiting_frame_pass():
    splitter = Splitter(8)
    stream = packed([SMALL, BIG])
    assert splitter.feed(stream) == [SMALL]
    assert splitter.error is not None
    splitter.limit = LIMIT
    assert splitter.feed(b"") == [BIG]
    assert splitter.error is None


def test_an_announced_length_takes_no_memory_before_its_bytes_arrive():
    tracemalloc.start()
    try:
        splitters = [Splitter(LIMIT) for _ in range(20)]
        for splitter in splitters:
            splitter.feed(pack_header(FrameType.REQUEST, 0, 1, 1, 0, LIMIT))
            assert room_of(splitter) is not None
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20 * 2 * LARGE


def test_a_large_body_takes_memory_in_proportion_to_what_arrived():
    splitter = Splitter(LIMIT)
    splitter.feed(pack_header(FrameType.REQUEST, 0, 1, 1, 0, LIMIT))
    arrived = 0
    tracemalloc.start()
    try:
        while (room := room_of(splitter)) is not None:
            assert len(room) <= 2 * max(LARGE, GROWTH * arrived)
            arrived += len(room)
            held, _ = tracemalloc.get_traced_memory()
            assert held <= 2 * GROWTH * arrived + 2 * LARGE
            whole = splitter.filled(len(room))
        _, peak = tracemalloc.get_traced_memory()
        assert peak <= 1.5 * LIMIT + 2 * LARGE
    finally:
        tracemalloc.stop()
    assert arrived == LIMIT
    assert len(whole[0][5]) == LIMIT


@given(st.lists(st.binary(max_size=64), max_size=8))
@settings(max_examples=examples(150))
def test_garbage_yields_frames_or_an_error_and_keeps_no_more_than_came(pieces):
    splitter = Splitter(64)
    for piece in pieces:
        for frame in splitter.feed(piece):
            assert len(frame[5]) <= 64
        if splitter.error is not None:
            break
        assert room_of(splitter) is None


def test_no_frame_type_is_that_of_a_skipped_frame():
    """Otherwise the session would handle what remains of a refused request as such a frame."""
    assert SKIPPED >= FIRST_OPTIONAL_TYPE
    assert SKIPPED not in set(FrameType)
