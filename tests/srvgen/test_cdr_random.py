"""CDR of random messages of every bundled class, and of bytes that somebody has tampered with."""

from __future__ import annotations

import tracemalloc
from functools import partial
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srvgen import CdrError, define, from_cdr, to_cdr
from tests.fuzz.fuzz_cdr import classes, decode_or_refuse
from tests.srvgen.cdr_reference import bundled_classes, random_message, reference_cdr

Everything = classes()[0]
of_each_fuzzed_class = pytest.mark.parametrize("cls", classes(), ids=lambda cls: cls._TYPE)


def tampered(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize("package", sorted({cls._TYPE.split("/")[0] for cls in bundled_classes()}))
def test_random_messages_have_the_bytes_that_the_rules_give_and_come_back(package):
    random = Random(package)
    for cls in (one for one in bundled_classes() if one._TYPE.startswith(f"{package}/")):
        for most in (0, 1, 3):
            message = random_message(cls, random, most)
            data = to_cdr(message)
            assert data == reference_cdr(message)
            again = from_cdr(cls, data)
            assert repr(again) == repr(message)  # by which nan equals nan
            assert to_cdr(again) == data


@given(st.integers(0), st.integers(0, 9))
@settings(max_examples=60, deadline=None)
def test_strings_and_sequences_of_any_length_shift_what_follows_rightly(seed, most):
    message = random_message(Everything, Random(seed), most)
    assert to_cdr(message) == reference_cdr(message)
    assert repr(from_cdr(Everything, to_cdr(message))) == repr(message)


@of_each_fuzzed_class
def test_no_beginning_of_a_message_is_a_message(cls):
    data = to_cdr(random_message(cls, Random(cls._TYPE), most=2))
    for size in range(len(data)):
        with pytest.raises(CdrError):
            from_cdr(cls, data[:size])


@given(st.sampled_from(classes()), st.integers(0), st.data())
@settings(max_examples=150, deadline=None)
def test_tampered_bytes_are_refused_or_are_another_message(cls, seed, data):
    body = to_cdr(random_message(cls, Random(seed)))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(4, len(body)))
        body = tampered(body, at, data.draw(st.binary(min_size=1, max_size=8)))
    decode_or_refuse(cls, body)


@pytest.mark.parametrize("length", [2**31 - 1, 2**32 - 1, 1 << 20])
@of_each_fuzzed_class
def test_memory_is_bounded_by_the_bytes_whatever_they_announce(cls, length):
    data = to_cdr(random_message(cls, Random(cls._TYPE)))
    from_cdr(cls, data)  # compiles the decoder
    lies = [tampered(data, at, length.to_bytes(4, "little")) for at in range(4, len(data) - 3, 4)]

    def peak():
        tracemalloc.start()
        for lie in lies:
            decode_or_refuse(cls, lie)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    # A second look where a thread of the test runner took memory meanwhile.
    assert any(peak() < 64 * len(data) + 100_000 for _ in range(2))


@pytest.mark.parametrize(
    "element",
    [
        "bool on",
        "uint16 n",
        "string s",
        "float32[] xs",
        "bool[] ons",
        "string[] names",
        "wstring w",
    ],
)
def test_memory_is_bounded_by_the_bytes_where_elements_are_as_small_as_can_be(element):
    text = f"Element[] elements\n{'=' * 80}\nMSG: demo_msgs/msg/Element\n{element}\n"
    cls = define("demo_msgs/msg/Demo", text.replace("\n=", "\n\n=", 1))
    smallest = to_cdr(cls._NESTED["elements"]())[4:]
    count = 20_000
    aligned = smallest if len(smallest) < 4 else smallest + bytes(-len(smallest) % 4)
    data = b"\0\1\0\0" + count.to_bytes(4, "little") + aligned * count
    tracemalloc.start()
    try:
        message = from_cdr(cls, data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(message.elements) == count
    assert peak < 64 * len(data)


def test_the_fuzzer_sees_what_no_documented_error_says():
    """A check that cannot fail is a defect: a planted bug must be caught."""

    def careless(cls: Any, data: bytes) -> Any:
        return from_cdr(cls, data) if data[4] < 2 else data.decode()

    look = partial(decode_or_refuse, Everything, decode=careless)
    look(b"\0\1\0\0" + bytes(4))
    with pytest.raises(UnicodeDecodeError):
        look(b"\0\1\0\0\xff" + bytes(4))


def test_the_fuzzer_sees_a_message_that_is_not_what_it_was_decoded_from():
    def forgetful(cls: Any, data: bytes) -> Any:
        return from_cdr(cls, data) if len(data) < 100 else cls()

    data = to_cdr(random_message(Everything, Random(1)))
    with pytest.raises(AssertionError):
        decode_or_refuse(Everything, data, decode=forgetful)
