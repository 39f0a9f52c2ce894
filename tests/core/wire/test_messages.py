"""Bodies of control frames arrive unchanged; any other bytes raise ProtocolError."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.wire import messages
from taskrpc.errors import ProtocolError

ID = b"i" * 16
TOPIC = messages.TopicEndpoint("/chatter", "std_msgs/msg/String", "", "/talker", 5, True, False)
BODIES = [
    (messages.decode_hello, messages.Hello(1, 2, ID, ID, 0, "/caller", "ana")),
    (messages.decode_hello_ack, messages.HelloAck(1, ID, ID, messages.Limits(calls=3))),
    (messages.decode_auth, messages.Auth(b"p" * 32)),
    (messages.decode_resolve, messages.Resolve("/add", "RIHS01_ab", "/caller")),
    (messages.decode_resolved, messages.Resolved(7, 0, "a/srv/A", "RIHS01_ab", "---\n", b"")),
    (messages.decode_listing, messages.Listing(["/talker"], [], [], [TOPIC])),
    (messages.decode_subscription, TOPIC),
    (messages.decode_announcement, messages.Announcement([messages.Publishing(3, TOPIC)])),
    (messages.decode_error, messages.ErrorBody("too large", "goal.x")),
]
each_body = pytest.mark.parametrize(("decode", "body"), BODIES, ids=lambda one: type(one).__name__)


@each_body
def test_body_arrives_as_it_was_sent(decode, body):
    assert decode(messages.encode(body)) == body


@each_body
def test_truncated_body_is_a_protocol_error(decode, body):
    data = messages.encode(body)
    for size in range(len(data)):
        with pytest.raises(ProtocolError, match=f"^{type(body).__name__} is not valid: "):
            decode(data[:size])


@each_body
def test_fields_of_a_later_version_are_skipped(decode, body):
    fields = msgspec.msgpack.decode(messages.encode(body))
    assert decode(msgspec.msgpack.encode([*fields, "later"])) == body


@given(st.sampled_from(BODIES), st.binary(max_size=60))
def test_any_bytes_are_a_body_or_a_protocol_error(case, data):
    decode, body = case
    try:
        assert type(decode(data)) is type(body)
    except ProtocolError:
        return


@pytest.mark.parametrize("name", ["/a\n", "/a\x1b[2J", "\x7f", "\x9b", "a" * 513])
def test_name_that_would_harm_a_log_is_refused(name):
    with pytest.raises(ProtocolError, match=r"^Resolve is not valid: "):
        messages.decode_resolve(messages.encode(messages.Resolve(name)))


@pytest.mark.parametrize("limits", [{"body": 0}, {"calls": 0}, {"bytes": 2**31 + 1}])
def test_impossible_limit_is_refused(limits):
    ack = messages.HelloAck(1, ID, ID, messages.Limits(**limits))
    with pytest.raises(ProtocolError, match=r"^HelloAck is not valid: "):
        messages.decode_hello_ack(messages.encode(ack))


def test_span_is_cut_from_the_start_of_a_body():
    span = bytes(range(messages.SPAN_SIZE))
    assert messages.cut_span(span + b"body") == (span, b"body")
    with pytest.raises(ProtocolError, match="without its span"):
        messages.cut_span(span[:-1])
