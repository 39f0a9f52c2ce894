"""Decoding CDR: what is read more generously than written, and the errors of invalid bytes."""

from __future__ import annotations

import tracemalloc
from functools import partial
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import srvgen
from srvgen import CdrError, FieldError, from_cdr, load, to_cdr
from tests.properties import examples
from tests.srvgen.cdr.reference import random_message
from tests.srvgen.cdr.tampered import decode_or_refuse, tampered_classes

Path_ = load("nav_msgs/msg/Path")
PoseStamped = load("geometry_msgs/msg/PoseStamped")
String = load("std_msgs/msg/String")
Bool = load("std_msgs/msg/Bool")


def define(text: str, name: str = "demo_msgs/msg/Demo") -> Any:
    return srvgen.define(name, text)


def test_decoded_message_has_exact_types_and_passes_its_check():
    scan = load("sensor_msgs/msg/LaserScan")(ranges=[1, 2])
    arrived = from_cdr(type(scan), to_cdr(scan))
    assert type(arrived.ranges) is type(type(scan)().ranges)
    before = repr(arrived)
    arrived._check()
    assert repr(arrived) == before


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_bytes_are_decoded_and_not_kept(kind):
    image = load("sensor_msgs/msg/Image")(data=b"12", encoding="mono8")
    buffer = bytearray(to_cdr(image))
    arrived = from_cdr(type(image), kind(buffer))
    buffer[:] = bytes(len(buffer))
    assert arrived == image


@pytest.mark.parametrize("extra", [0, 1, 2, 3])
def test_up_to_three_bytes_of_padding_may_follow(extra):
    assert from_cdr(Bool, b"\0\1\0\0\1" + b"\xff" * extra).data is True


def test_options_in_the_header_are_ignored():
    assert from_cdr(Bool, b"\0\1\xab\3\1").data is True


def test_string_of_length_0_is_decoded_as_empty():
    assert from_cdr(String, b"\0\1\0\0" + bytes(4)).data == ""
    names = define("string[] names\nstring last")
    arrived = from_cdr(names, b"\0\1\0\0" + bytes.fromhex("02000000 00000000 00000000 00000000"))
    assert (arrived.names, arrived.last) == (["", ""], "")


@pytest.mark.parametrize(
    ("text", "data", "path", "problem"),
    [
        ("bool on", "", "", "expected a header of 4 bytes at byte 0, got the end at byte 3"),
        ("int32 x", "0102", "x", "expected int32 at byte 4, got the end at byte 6"),
        ("uint8 a\nint64 x", "01000000", "x", "expected int64 at byte 12, got the end at byte 8"),
        ("float64[4] c", "00", "c", "expected float64[4] at byte 4, got the end at byte 5"),
        ("string s", "0500", "s",
         "expected the length of a string at byte 4, got the end at byte 6"),
        ("string s", "05000000 616263", "s",
         "expected the NUL of a string at byte 12, got the end at byte 11"),
        ("string s", "ffffffff c3", "s",
         "expected the NUL of a string at byte 4294967302, got the end at byte 9"),
        ("string s", "03000000 61c300", "s", "expected UTF-8, got 0xc3 as byte 1 of the string"),
        ("string s", "03000000 edb080 00", "s", "expected UTF-8, got 0xed as byte 0 of the string"),
        ("string s", "02000000 6162", "s",
         "expected a string that ends in NUL, got another byte there"),
        ("string<=2 s", "04000000 61626300", "s", "expected at most 2 characters, got 3"),
        ("string[] s", "02000000 02000000 61000000 02000000 6162", "s[1]",
         "expected a string that ends in NUL, got another byte there"),
        ("string[] s", "01000000 02000000 ff00", "s[0]",
         "expected UTF-8, got 0xff as byte 0 of the string"),
        ("string[] s", "01000000 09000000 6100", "s[0]",
         "expected the NUL of a string at byte 20, got the end at byte 14"),
        ("string<=1[] s", "01000000 03000000 616200", "s[0]",
         "expected at most 1 characters, got 2"),
        ("string[] s", "ffffffff", "s",
         "expected 4294967295 elements, got 0 bytes, which cannot hold them"),
        ("string[2] s", "01000000 000000", "s",
         "expected 2 elements, got 7 bytes, which cannot hold them"),
        ("string[2] s", "04000000 610000", "s",
         "expected 2 elements, got 7 bytes, which cannot hold them"),
        ("string[2] s", "04000000 61620000", "s[1]",
         "expected the length of a string at byte 12, got the end at byte 12"),
        ("wstring s", "02000000 61000000", "s",
         "expected 2 code units, got 4 bytes, which cannot hold them"),
        ("wstring s", "01000000 00000100", "s", "expected UTF-16 code units, got 0x10000"),
        ("wstring s", "02000000 61000000 00d80000", "s",
         "expected UTF-16, got a lone surrogate as code unit 1"),
        ("wstring<=1 s", "02000000 61000000 62000000", "s", "expected at most 1 characters, got 2"),
        ("wstring[] s", "01000000 01000000 00dc0000", "s[0]",
         "expected UTF-16, got a lone surrogate as code unit 0"),
        ("wstring[] s", "01000000 05000000 00dc0000", "s[0]",
         "expected 5 code units, got 4 bytes, which cannot hold them"),
        ("bool on", "02", "on", "expected a bool as 0 or 1, got 2"),
        ("bool[] on", "03000000 0100ff", "on[2]", "expected a bool as 0 or 1, got 255"),
        ("bool[3] on", "010200", "on[1]", "expected a bool as 0 or 1, got 2"),
        ("float32[] x", "02000000 00000000", "x",
         "expected 2 elements, got 4 bytes, which cannot hold them"),
        ("uint8[] x", "ffffffff 00", "x",
         "expected 4294967295 elements, got 1 bytes, which cannot hold them"),
        ("uint8[<=2] x", "03000000 000000", "x", "expected at most 2 elements, got 3"),
        ("bool on", "01000000 01", "", "expected the message to end at byte 5, got 9 bytes"),
        ("uint8[] x", "00000000 00000000", "",
         "expected the message to end at byte 8, got 12 bytes"),
    ],
)  # fmt: skip
def test_invalid_bytes_give_an_error_with_the_path_of_the_field(text, data, path, problem):
    body = bytes.fromhex(data)
    with pytest.raises(CdrError) as caught:
        from_cdr(define(text), b"\0\1\0\0" + body if body else b"\0\1\0")
    assert (caught.value.path, caught.value.problem) == (path, problem)


def test_paths_lead_through_nested_messages_and_sequences():
    path = Path_(poses=[PoseStamped(), PoseStamped(), PoseStamped()])
    path.poses[2].header.frame_id = "map"
    data = to_cdr(path).replace(b"map", b"ma\xff")
    with pytest.raises(CdrError) as caught:
        from_cdr(Path_, data)
    assert str(caught.value) == (
        "poses[2].header.frame_id: expected UTF-8, got 0xff as byte 2 of the string"
    )
    with pytest.raises(CdrError, match=r"^poses\[2\]\.pose\.orientation\.w: expected float64 at"):
        from_cdr(Path_, data.replace(b"ma\xff", b"map")[:-1])


def test_more_messages_than_the_bytes_can_hold_are_refused_before_any_is_made():
    data = to_cdr(Path_())[:-4] + (2**32 - 1).to_bytes(4, "little") + bytes(64)
    with pytest.raises(CdrError, match=r"^poses: expected 4294967295 elements, got 64 bytes"):
        from_cdr(Path_, data)


@pytest.mark.parametrize(
    ("header", "what"),
    [
        ("00000000", "00 00, big-endian XCDR1"),
        ("00030000", "00 03, a parameter list"),
        ("00070000", "00 07, XCDR2"),
        ("00090000", "00 09, delimited XCDR2"),
        ("ffff0000", "ff ff, an unknown representation"),
    ],
)
def test_other_representations_are_refused_by_name(header, what):
    with pytest.raises(CdrError) as caught:
        from_cdr(Bool, bytes.fromhex(header) + b"\1")
    assert str(caught.value) == f"expected the header 00 01 of XCDR1, got {what}"


def test_cdr_error_is_a_field_error():
    """One `except FieldError` is enough for messages of any origin."""
    assert issubclass(CdrError, FieldError)
    assert issubclass(CdrError, ValueError)


Everything = tampered_classes()[0]


of_each_tampered_class = pytest.mark.parametrize(
    "cls", tampered_classes(), ids=lambda cls: cls._TYPE
)


def tampered(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize(
    "fields", ["string[2] names", "wstring[2] names", "Inner[2] inners", "Inner inner"]
)
def test_elements_of_the_minimum_size_are_accepted(fields):
    """An empty wstring has 4 bytes, and so has a string of length 0 as some vendors send it."""
    texts = {"Element": fields, "Inner": "wstring name"}
    nested = [f"\n{'=' * 80}\nMSG: demo_msgs/msg/{name}\n{texts[name]}\n" for name in texts]
    cls = srvgen.define("demo_msgs/msg/Least", "Element[] elements\n" + "".join(nested))
    strings = 1 if fields == "Inner inner" else 2
    data = b"\0\1\0\0" + (3).to_bytes(4, "little") + bytes(4 * strings * 3)
    assert len(from_cdr(cls, data).elements) == 3


@pytest.mark.parametrize(
    ("fields", "least"),
    [
        ("uint8 a", 1),
        ("uint32[3] a", 12),
        ("string a", 4),
        ("string a\nstring b\nuint8 c", 9),
        ("wstring a", 4),
        ("uint8[] a\nuint8[<=9] b", 8),
        ("string[2] a", 8),
        ("wstring[2] a", 8),
        ("Inner inner", 5),
        ("Inner[2] inners", 10),
        ("Inner[] inners", 4),
    ],
)
def test_more_elements_than_the_bytes_can_hold_are_refused_before_any_is_made(fields, least):
    inner = f"\n{'=' * 80}\nMSG: demo_msgs/msg/Inner\nuint8 number\nstring name\n"
    element = f"\n{'=' * 80}\nMSG: demo_msgs/msg/Element\n{fields}\n"
    text = "Element[] elements\n" + element + (inner if "Inner" in fields else "")
    cls = srvgen.define("demo_msgs/msg/Least", text)
    for size in (least * 10, least * 10 + least - 1):
        data = b"\0\1\0\0" + (11).to_bytes(4, "little") + bytes(size)
        with pytest.raises(CdrError, match=r"elements: .*11 elements"):
            from_cdr(cls, data)
    if least % 4 == 0:  # else there is padding between them
        data = b"\0\1\0\0" + (10).to_bytes(4, "little") + bytes(least * 10)
        assert len(from_cdr(cls, data).elements) == 10


@of_each_tampered_class
def test_truncated_message_is_refused(cls):
    data = to_cdr(random_message(cls, Random(cls._TYPE), most=2))
    for size in range(len(data)):
        with pytest.raises(CdrError):
            from_cdr(cls, data[:size])


@given(st.sampled_from(tampered_classes()), st.integers(0), st.data())
@settings(max_examples=examples(150))
def test_tampered_bytes_are_refused_or_are_another_message(cls, seed, data):
    body = to_cdr(random_message(cls, Random(seed)))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(4, len(body)))
        body = tampered(body, at, data.draw(st.binary(min_size=1, max_size=8)))
    decode_or_refuse(cls, body)


@pytest.mark.parametrize("length", [2**31 - 1, 2**32 - 1, 1 << 20])
@of_each_tampered_class
def test_memory_is_bounded_by_the_size_of_the_data(cls, length):
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

    # Measured twice: a thread of the test runner may allocate memory meanwhile.
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
def test_memory_is_bounded_for_the_smallest_elements(element):
    text = f"Element[] elements\n{'=' * 80}\nMSG: demo_msgs/msg/Element\n{element}\n"
    cls = srvgen.define("demo_msgs/msg/Demo", text.replace("\n=", "\n\n=", 1))
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


def test_check_finds_an_undocumented_error():
    """A check that cannot fail is a defect: a planted bug must be caught."""

    def careless(cls: Any, data: bytes) -> Any:
        return from_cdr(cls, data) if data[4] < 2 else data.decode()

    look = partial(decode_or_refuse, Everything, decode=careless)
    look(b"\0\1\0\0" + bytes(4))
    with pytest.raises(UnicodeDecodeError):
        look(b"\0\1\0\0\xff" + bytes(4))


def test_check_finds_a_message_that_encodes_to_other_bytes():
    def forgetful(cls: Any, data: bytes) -> Any:
        return from_cdr(cls, data) if len(data) < 100 else cls()

    data = to_cdr(random_message(Everything, Random(1)))
    with pytest.raises(AssertionError):
        decode_or_refuse(Everything, data, decode=forgetful)
