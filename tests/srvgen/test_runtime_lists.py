"""Long lists of bytes, booleans and texts are checked by functions of C, not element by element."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

import srvgen
from srvgen import FieldError
from srvgen._runtime import bounded_text, to_boolean, to_byte, to_items, to_text
from srvgen.classes.loader import define
from taskrpc.core.transport.codec import codec_of

COUNT = 10_000
MOST_CALLS = 1_000
"""Function calls that a message may take, with those that compile its first encoder."""


@pytest.fixture
def lists():
    text = "byte[] data\nbool[] flags\nstring[] names\nstring<=4[] short\n"
    return define("list_msgs/msg/Lists", text)


def calls_of(work: Callable[[], Any]) -> int:
    """The functions of Python and of C that a piece of work calls."""
    calls = 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        work()
    finally:
        sys.setprofile(None)
    return calls


def test_a_long_list_takes_no_function_call_for_each_element(lists):
    codec = codec_of(lists)
    data = [bytes((number % 256,)) for number in range(COUNT)]
    flags, names = [True, False] * (COUNT // 2), ["Zoë", "Ada"] * (COUNT // 2)
    message = lists(data=data, flags=flags, names=names, short=names)
    body, cdr = codec.encode(message), srvgen.to_cdr(message)
    works = {
        "check": message._check,
        "check of integers": lists(data=list(map(ord, data)))._check,
        "encode": partial(codec.encode, message),
        "decode": partial(codec.decode, body),
        "to_builtins": partial(srvgen.to_builtins, message),
        # CDR has texts one by one; bytes and booleans are one piece.
        "to_cdr": partial(srvgen.to_cdr, lists(data=data, flags=flags)),
        "from_cdr": partial(srvgen.from_cdr, lists, srvgen.to_cdr(lists(data=data, flags=flags))),
    }
    calls = {name: calls_of(work) for name, work in works.items()}
    assert not {name: count for name, count in calls.items() if count > MOST_CALLS}
    assert codec.decode(body) == message == srvgen.from_cdr(lists, cdr)
    assert srvgen.to_builtins(message)["data"] == list(map(ord, data))


def test_the_count_of_calls_sees_one_call_for_each_element():
    assert calls_of(lambda: [to_byte(b"x", "") for _ in range(COUNT)]) > COUNT


@pytest.mark.parametrize(
    ("convert", "values", "expected"),
    [
        (to_byte, [b"a", b"b"], [b"a", b"b"]),
        (to_byte, [0, 255, True], [b"\0", b"\xff", b"\1"]),
        (to_byte, [b"a", 1, bytearray(b"c")], [b"a", b"\1", b"c"]),
        (to_byte, [], []),
        (to_boolean, [True, 0, 1], [True, False, True]),
        (to_text, ["a", "ö", ""], ["a", "ö", ""]),
        (bounded_text(2), ["ab", ""], ["ab", ""]),
    ],
)
def test_elements_become_exact(convert, values, expected):
    made = to_items(values, "field", convert)
    assert made == expected
    assert list(map(type, made)) == list(map(type, expected))


@pytest.mark.parametrize(
    ("convert", "values", "problem"),
    [
        (to_byte, [b"a", b""], r"field\[1\]: expected one byte, got b'' \(bytes\)"),
        (to_byte, [b"", b"ab"], r"field\[0\]: expected one byte, got b''"),
        (to_byte, [1, 256], r"field\[1\]: expected uint8 in 0..255, got 256"),
        (to_byte, [2**100], r"field\[0\]: expected uint8 in 0..255"),
        (to_byte, ["x"], r"field\[0\]: expected uint8, got 'x'"),
        (to_boolean, [True, 2], r"field\[1\]: expected true or false, got 2"),
        (to_text, ["a", 1], r"field\[1\]: expected string, got 1"),
        (to_text, ["\ud83d", "\ude00"], r"field\[0\]: expected text that UTF-8 can encode"),
        (bounded_text(2), ["ab", "abc"], r"field\[1\]: expected at most 2 characters, got 3"),
    ],
)
def test_a_wrong_element_is_named_with_its_index(convert, values, problem):
    with pytest.raises(FieldError, match=problem):
        to_items(values, "field", convert)
