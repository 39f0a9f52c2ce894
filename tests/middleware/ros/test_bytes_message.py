"""Bytes inside a UInt8MultiArray."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.middleware.ros import bytes_message

Class = srvgen.load(bytes_message.TYPE)


@given(st.binary(max_size=300))
def test_encoding_is_that_of_srvgen(data):
    assert bytes_message.pack(data) == srvgen.to_cdr(Class(data=data))


@given(st.binary(max_size=300), st.integers(0, 7))
def test_bytes_arrive_also_with_padding_behind_them(data, padding):
    assert bytes_message.unpack(bytes_message.pack(data) + bytes(padding)) == data


@pytest.mark.parametrize(
    "body", [b"", bytes(20), bytes_message.pack(b"abc")[:-1], b"\x00\x00" + bytes(14)]
)
def test_other_message_gives_none(body):
    assert bytes_message.unpack(body) is None


@given(st.binary(max_size=40))
def test_garbage_raises_nothing(data):
    bytes_message.unpack(data)
