"""The datagrams of a tunnel: what is packed is read back, and garbage is none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.transport.tunnel import frames
from taskrpc.core.transport.tunnel.frames import Kind

IDS = st.integers(0, 2**64 - 1)
NUMBERS = st.integers(0, 2**32 - 1)
PLACES = st.text(st.characters(codec="utf-8"), min_size=1, max_size=100)


@given(st.sampled_from(Kind), IDS, NUMBERS, IDS, st.binary(max_size=100))
def test_a_datagram_is_read_back(kind, to, number, limit, data):
    parsed = frames.parse(frames.pack(kind, to, number, limit) + data)
    assert parsed == (kind, to, number, limit, data)


@given(IDS, PLACES, IDS)
def test_a_request_for_a_connection_is_read_back(own_id, place, limit):
    *parsed, data = frames.parse(frames.pack_syn(own_id, place, limit))
    assert parsed == [Kind.SYN, 0, 0, limit]
    assert frames.parse_syn(data) == (own_id, place)


@given(IDS, IDS)
def test_an_acceptance_is_read_back(to, own_id):
    *parsed, data = frames.parse(frames.pack_ack(to, own_id, 5))
    assert parsed == [Kind.ACK, to, 0, 5]
    assert frames.parse_ack(data) == own_id


@given(st.text(max_size=300))
def test_a_reason_is_read_back_up_to_its_limit(reason):
    reason = reason.encode("utf-8", "replace").decode()
    parsed = frames.parse(frames.pack_reset(7, reason))
    assert frames.parse_reset(parsed[-1]) == reason[: frames.MAX_REASON]


@given(st.binary(max_size=200))
def test_garbage_is_no_datagram_and_raises_nothing(garbage):
    parsed = frames.parse(garbage)
    if parsed is not None:
        frames.parse_syn(parsed[-1])
        frames.parse_ack(parsed[-1])
        frames.parse_reset(parsed[-1])


@pytest.mark.parametrize("data", [b"", b"1234567", b"12345678", bytes(8) + b"\xff", bytes(600)])
def test_an_invalid_request_for_a_connection_is_refused(data):
    assert frames.parse_syn(memoryview(data)) is None


def test_another_version_is_no_datagram():
    datagram = bytearray(frames.pack(Kind.DATA, 1))
    assert frames.parse(bytes(datagram)) is not None
    datagram[0] += 0x10
    assert frames.parse(bytes(datagram)) is None
