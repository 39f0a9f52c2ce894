"""Messages as CDR: what is encoded is decoded again, and every mistake is an InvalidRequest."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.core.transport.tunnel import cdr
from taskrpc.errors import InvalidRequest

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
String = srvgen.load("std_msgs/msg/String")


@given(st.text())
def test_decode_returns_what_was_encoded(text):
    message = String(data=text.replace("\0", ""))
    assert cdr.decode(String, cdr.encode(String, message)) == message


@pytest.mark.parametrize("value", [AddTwoInts.Request(), String, "hello", None])
def test_value_of_another_class_is_refused(value):
    with pytest.raises(InvalidRequest, match="expected a std_msgs/msg/String, got "):
        cdr.encode(String, value)


def test_field_with_an_invalid_value_is_named_once():
    with pytest.raises(InvalidRequest) as caught:
        cdr.encode(AddTwoInts.Request, AddTwoInts.Request(a=2**63))
    assert caught.value.path == "a"
    assert str(caught.value).count("a: ") == 1


@given(st.binary(max_size=60))
def test_any_bytes_are_a_message_or_an_invalid_request(body):
    with contextlib.suppress(InvalidRequest):
        assert isinstance(cdr.decode(String, body), String)


def test_error_for_invalid_bytes_names_the_class():
    with pytest.raises(InvalidRequest, match="this is not a std_msgs/msg/String in CDR: "):
        cdr.decode(String, b"")
