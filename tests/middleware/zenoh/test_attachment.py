"""Attachments have 33 bytes, as those of rmw_zenoh."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.middleware.zenoh import attachment

VECTOR = bytes.fromhex("0100000000000000 0052b0975be7e918 10 137685e14fc8455eb954cb4f81790c64")
INT64 = st.integers(-(2**63), 2**63 - 1)


def test_the_attachment_of_a_real_request_is_read_and_written():
    found = attachment.parse(VECTOR)
    assert found is not None
    assert found.sequence == 1
    assert found.gid == bytes.fromhex("137685e14fc8455eb954cb4f81790c64")
    assert attachment.pack(*found) == VECTOR
    assert len(VECTOR) == 33


@given(INT64, INT64, st.binary(min_size=16, max_size=16), st.binary(max_size=9))
def test_attachments_survive_a_round_trip_and_bytes_behind_them(sequence, stamp, gid, more):
    assert attachment.parse(attachment.pack(sequence, stamp, gid) + more) == (sequence, stamp, gid)


@given(st.binary(max_size=40))
def test_garbage_is_no_error(data):
    found = attachment.parse(data)
    assert found is None or data[16] == 16


def test_a_gid_of_another_size_is_refused():
    assert attachment.parse(VECTOR[:16] + b"\x08" + VECTOR[17:]) is None
