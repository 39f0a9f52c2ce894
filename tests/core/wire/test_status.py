"""An error arrives unchanged, and a peer can cause nothing worse than an error."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc import errors
from taskrpc.core.wire import messages, status
from taskrpc.core.wire.frames import Flag
from taskrpc.core.wire.messages import ErrorBody
from taskrpc.core.wire.status import MAX_MESSAGE, from_wire, to_wire
from taskrpc.errors import Code, TaskRpcError
from tests.properties import examples

TRAVEL = [
    errors.DeadlineExceeded("too late"),
    errors.DeadlineExceeded("never begun", not_executed=True),
    errors.ServiceUnavailable("no service /x here"),
    errors.TypeMismatch("two definitions"),
    errors.InvalidRequest("goal.position.x", "expected a number, got text"),
    errors.InvalidRequest("", "not a message"),
    errors.ServerBusy("queue full", retry_after=0.25),
    errors.ServerBusy("queue full"),
    errors.OutcomeUnknown("lost"),
    errors.AuthenticationFailed("not this token"),
    errors.PermissionDenied("not you"),
    errors.SessionExpired("forgotten"),
    errors.ProtocolError("garbage"),
    errors.ProtocolError("garbage", not_executed=True),
    errors.HandlerFailed(Code.INTERNAL, "see the log, call 7"),
    errors.HandlerFailed(Code.UNAVAILABLE, "later"),
    errors.HandlerFailed(Code.ID_REUSED),
    TaskRpcError("cancelled by the caller"),
    TaskRpcError("cancelled by the caller", not_executed=True),
]


def travelled(error):
    return from_wire(*to_wire(error))


@pytest.mark.parametrize("error", TRAVEL, ids=repr)
def test_an_error_arrives_as_it_was(error):
    arrived = travelled(error)
    assert type(arrived) is type(error)
    assert str(arrived) == str(error)
    assert arrived.not_executed is error.not_executed
    for name in ("path", "problem", "code", "message"):
        assert getattr(arrived, name, None) == getattr(error, name, None)


@pytest.mark.parametrize("code", Code)
def test_an_error_of_a_callback_arrives_as_handler_failed_with_its_code(code):
    arrived = travelled(errors.HandlerError(code, "because"))
    assert type(arrived) is errors.HandlerFailed
    assert (arrived.code, arrived.message) == (code, "because")
    assert arrived.not_executed is (code is Code.UNAVAILABLE)


@pytest.mark.parametrize(
    "error",
    [
        errors.NameInUse("/x"),
        errors.InvalidName("a b", 1),
        errors.WouldDeadlock("no"),
        errors.CannotListen("no"),
        errors.ConnectionLost("no"),
    ],
)
def test_errors_of_one_side_only_arrive_as_the_base_error(error):
    arrived = travelled(error)
    assert type(arrived) is TaskRpcError
    assert str(arrived) == str(error)
    assert arrived.not_executed is error.not_executed


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_retry_after_is_rounded_up(seconds):
    wire = to_wire(errors.ServerBusy("full", retry_after=seconds))
    assert 0 <= wire.retry_after <= 0xFFFF
    arrived = from_wire(*wire).retry_after
    wanted = 0.0 if math.isnan(seconds) else min(max(seconds, 0.0), 655.35)
    assert wanted - 1e-9 <= arrived <= wanted + 0.01 + 1e-9


def test_an_error_without_the_flag_is_no_promise():
    wire = to_wire(errors.ServerBusy("full"))
    assert wire.flags == Flag.NOT_EXECUTED
    assert from_wire(wire.code, 0, 0, wire.body).not_executed is None
    assert from_wire(Code.INTERNAL, Flag.FROM_HANDLER, 0, wire.body).not_executed is False


@given(st.text(), st.text())
def test_sentences_and_paths_are_cut_at_a_kibibyte_between_characters(text, path):
    wire = to_wire(errors.InvalidRequest(path * 50, text * 50))
    body = messages.decode_error(wire.body)
    for sent, meant in ((body.message, text * 50), (body.path, path * 50)):
        assert len(sent.encode()) <= MAX_MESSAGE
        if len(meant.encode("utf-8", "backslashreplace")) > MAX_MESSAGE:
            assert sent.endswith("…")
            assert meant.encode("utf-8", "backslashreplace").startswith(sent[:-1].encode())
            assert len(sent.encode()) > MAX_MESSAGE - 4
        else:
            assert sent == meant


def test_half_a_surrogate_pair_does_not_stop_an_error():
    assert str(travelled(TaskRpcError("file \udcff"))) == r"file \udcff"


def test_a_sentence_cannot_drive_a_terminal():
    body = messages.encode(ErrorBody("\x1b[2J\x07 two\nlines\t\x9b", "a\x00b"))
    arrived = from_wire(Code.INVALID_ARGUMENT, 0, 0, body)
    assert arrived.problem == "\\x1b[2J\\x07 two\nlines\t\\x9b"
    assert arrived.path == "a\\x00b"


def test_a_peers_long_sentence_is_cut_here_too():
    body = messages.encode(ErrorBody("x" * 10**6))
    assert len(str(from_wire(Code.UNKNOWN, 0, 0, body)).encode()) == MAX_MESSAGE


HOSTILE = [
    b"",
    b"\xff",
    b"\x91\xa2\xff\xfe",
    b"\x92\x01\x02",
    b"\xc0",
    b"\x93\xa1a\xa1b" + b"\x91" * 100_000,
    b"\xdd\xff\xff\xff\xff",
    b"\x91\xdb\xff\xff\xff\xffabc",
    b"\x91\xa1a!",
]


@pytest.mark.parametrize("body", HOSTILE)
def test_a_hostile_body_is_an_error_without_a_message(body):
    arrived = from_wire(Code.RESOURCE_EXHAUSTED, Flag.NOT_EXECUTED, 5, body)
    assert type(arrived) is errors.ServerBusy
    assert str(arrived) == "the peer sent an error without a readable message"


# What msgpack can carry: no half of a surrogate pair.
characters = st.characters(exclude_categories=["Cs"])
sentences = st.builds(ErrorBody, st.text(characters), st.text(characters))


@given(
    st.one_of(st.integers(0, 30), st.integers(0, 0xFFFF)),
    st.integers(0, 255),
    st.integers(0, 0xFFFF),
    st.one_of(st.binary(max_size=50), sentences.map(messages.encode)),
)
@settings(max_examples=examples(150))
def test_any_error_frame_becomes_an_error(code, flags, retry_after, body):
    arrived = from_wire(code, flags, retry_after, body)
    assert isinstance(arrived, TaskRpcError)
    assert (arrived.not_executed is True) is bool(flags & Flag.NOT_EXECUTED)
    assert len(str(arrived).encode()) <= 2 * MAX_MESSAGE + 2


def test_each_code_means_one_class():
    classes = [cls for cls, _ in status._CODES]
    codes = [code for _, code in status._CODES]
    assert len(set(classes)) == len(classes)
    assert len(set(codes)) == len(codes)
