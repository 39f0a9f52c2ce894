"""A stream over datagrams: its bytes arrive unchanged, or the connection is reset."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.core.transport.tunnel import frames, stream
from taskrpc.core.transport.tunnel.frames import MAX_DATA, Kind
from taskrpc.core.transport.tunnel.stream import WINDOW, State, Stream
from tests.properties import examples


def pair(window=WINDOW):
    return Stream(2, window, window), Stream(1, window, window)


def taken(one):
    out, one.out = one.out, []
    return out


def reason_of(datagrams):
    """The reason in the last datagram, which is a reset."""
    return frames.parse_reset(frames.parse(datagrams[-1])[-1])


def deliver(datagrams, to, *, read=True):
    """Pass datagrams to an end; return the bytes for its program."""
    got = b""
    for each in datagrams:
        data = to.feed(frames.parse(each))
        got += data or b""
        if read and data:
            to.read(len(data))
    return got


def exchange(one, other):
    """Deliver everything in both directions until nothing is sent; return both programs' bytes."""
    got_one, got_other = b"", b""
    while one.out or other.out:
        got_other += deliver(taken(one), other)
        got_one += deliver(taken(other), one)
    return got_one, got_other


def test_small_bytes_travel_at_once_in_one_datagram():
    one, other = pair()
    one.write(b"hello")
    (datagram,) = taken(one)
    assert len(datagram) == frames.HEADER_SIZE + 5
    assert deliver([datagram], other) == b"hello"


def test_large_bytes_travel_in_several_datagrams_of_limited_size():
    one, other = pair()
    data = bytes(range(256)) * 1024
    one.write(data)
    assert all(len(each) <= MAX_DATA + frames.HEADER_SIZE for each in one.out)
    assert exchange(one, other) == (b"", data)


def test_bytes_beyond_the_window_wait_until_the_other_end_reads():
    one, other = pair(window=100)
    one.write(bytes(250))
    assert one.waiting_size == 150
    assert len(deliver(taken(one), other, read=False)) == 100
    assert (taken(other), one.out) == ([], [])
    other.read(49)
    assert taken(other) == []  # not for each read
    other.read(1)
    assert deliver(taken(other), one) == b""
    assert one.waiting_size == 100
    assert exchange(one, other)[1] == bytes(50) + bytes(100)


def test_a_response_carries_the_credit_so_that_calls_need_no_other_datagram():
    one, other = pair(window=100)
    for _ in range(100):
        one.write(bytes(40))
        assert len(one.out) == 1
        deliver(taken(one), other)
        other.write(bytes(40))
        assert len(other.out) == 1
        deliver(taken(other), one)
    assert one.waiting_size == other.waiting_size == 0


def test_the_end_follows_all_bytes():
    one, other = pair(window=100)
    one.write(bytes(250))
    one.close()
    one.write(b"too late")
    assert one.state is State.CLOSING
    assert exchange(one, other)[1] == bytes(250)
    assert (one.state, other.ended) == (State.FINISHED, True)


def test_after_the_end_no_credit_is_sent():
    one, other = pair(window=100)
    one.write(bytes(100))
    one.close()
    deliver(taken(one), other, read=False)
    other.read(100)
    assert other.out == []


def test_reset_tells_the_other_end_and_drops_what_waits():
    one, other = pair(window=100)
    one.write(bytes(250))
    one.reset("enough")
    assert one.waiting_size == 0
    deliver(taken(one)[-1:], other)
    assert (one.state, other.state) == (State.RESET, State.RESET)
    assert other.out == []


def test_a_missing_datagram_resets_both_ends():
    one, other = pair()
    one.write(b"lost")
    taken(one)
    one.write(b"next")
    assert deliver(taken(one), other) == b""
    resets = taken(other)
    assert reason_of(resets) == "a datagram is missing"
    deliver(resets, one)
    assert one.state is State.RESET


def test_a_repeated_datagram_changes_nothing():
    one, other = pair()
    one.write(b"a")
    one.write(b"b")
    first, second = taken(one)
    assert deliver([first, first, second, first, second], other) == b"ab"
    assert other.state is State.OPEN


def test_an_end_after_a_missing_datagram_is_no_end():
    one, other = pair()
    one.write(b"lost")
    one.close()
    _, end = taken(one)
    deliver([end], other)
    assert (other.ended, other.state) == (False, State.RESET)


def test_a_reset_after_the_end_takes_nothing_back():
    one, other = pair()
    one.write(b"last words")
    one.close()
    assert deliver([*taken(one), frames.pack_reset(1, "")], other) == b"last words"
    assert (other.ended, other.state) == (True, State.OPEN)


def test_more_bytes_than_the_window_reset_the_connection():
    one, other = Stream(2, 1000), Stream(1, 0, window=100)
    one.write(bytes(101))
    assert deliver(taken(one), other) == b""
    assert reason_of(taken(other)) == "more bytes than the window allows"


def test_numbers_wrap_around(monkeypatch):
    monkeypatch.setattr(stream, "_NUMBERS", 4)
    one, other = pair()
    for n in range(20):
        one.write(b"%d " % n)
        datagrams = taken(one)
        assert deliver(datagrams * 2, other) == b"%d " % n
    assert other.state is State.OPEN


class Wire:
    """Datagrams on their way in one direction, with faults that Hypothesis draws."""

    def __init__(self, draw, faults):
        self._draw, self._faults = draw, faults
        self.waiting = []

    def arriving(self):
        datagrams, self.waiting = self.waiting, []
        for each in datagrams:
            fault = self._draw(st.sampled_from(["none"] * 8 + self._faults))
            if fault == "lose":
                continue
            if fault == "delay":
                self.waiting.append(each)
                continue
            yield each
            if fault == "repeat":
                yield each
            if fault == "garbage":
                yield self._draw(st.binary(max_size=60))


@settings(max_examples=examples(40))
@given(st.data())
@pytest.mark.parametrize("faults", [[], ["repeat"], ["lose", "delay", "repeat", "garbage"]])
def test_bytes_arrive_unchanged_or_the_connection_is_reset(faults, data):
    draw, window = data.draw, data.draw(st.sampled_from([1, 7, 64, 1000]))
    ends = pair(window)
    wires = [Wire(draw, faults), Wire(draw, faults)]
    written, got, unread = [b"", b""], [b"", b""], [0, 0]
    closed = [False, False]
    for _ in range(draw(st.integers(1, 40))):
        side = draw(st.integers(0, 1))
        one, other = ends[side], ends[1 - side]
        match draw(st.sampled_from(["write", "arrive", "arrive", "read", "close"])):
            case "write" if not closed[side]:
                piece = draw(st.binary(max_size=200))
                written[side] += piece
                one.write(piece)
            case "arrive":
                for each in wires[1 - side].arriving():
                    parsed = frames.parse(each)
                    if parsed is None or parsed[1] != side + 1:
                        continue
                    if (arrived := one.feed(parsed)) is not None:
                        got[side] += arrived
                        unread[side] += len(arrived)
            case "read" if unread[side]:
                count = draw(st.integers(1, unread[side]))
                unread[side] -= count
                one.read(count)
            case "close" if draw(st.booleans()):
                closed[side] = True
                one.close()
        wires[side].waiting += taken(one)
        wires[1 - side].waiting += taken(other)
        for n in (0, 1):
            assert unread[n] <= window
            assert written[1 - n].startswith(got[n])
            if ends[n].ended:
                assert closed[1 - n]
                assert got[n] == written[1 - n]
    if "lose" not in faults:
        for _ in range(3000):
            if not any(wire.waiting for wire in wires) and not any(unread):
                break
            for side in (0, 1):
                for each in list(wires[1 - side].waiting):
                    arrived = ends[side].feed(frames.parse(each))
                    got[side] += arrived or b""
                    unread[side] += len(arrived or b"")
                wires[1 - side].waiting.clear()
                ends[side].read(unread[side])
                unread[side] = 0
                wires[side].waiting += taken(ends[side])
        for n in (0, 1):
            assert ends[n].state is not State.RESET
            assert got[n] == written[1 - n] or ends[1 - n].ended
            assert ends[n].ended == (closed[1 - n] and got[n] == written[1 - n])


@given(
    st.lists(st.one_of(st.binary(max_size=80), st.tuples(st.sampled_from(Kind), st.integers(0, 5))))
)
def test_no_sequence_of_datagrams_raises_or_passes_the_window(datagrams):
    one = Stream(1, 50, window=100)
    one.write(bytes(200))
    received = 0
    for each in datagrams:
        data = each if isinstance(each, bytes) else frames.pack(*each[:1], 2, each[1]) + bytes(30)
        parsed = frames.parse(data)
        if parsed is not None:
            received += len(one.feed(parsed) or b"")
    assert received <= 100
