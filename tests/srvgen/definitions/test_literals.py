"""The values of constants and defaults follow the official rules."""

import math

import pytest

from srvgen.definitions.field_types import parse_type
from srvgen.definitions.literals import parse_default, parse_scalar, unescape
from srvgen.errors import InvalidText


@pytest.mark.parametrize(
    ("text", "base", "value"),
    [
        ("TRUE", "bool", True),
        ("0", "bool", False),
        ("0o17", "uint8", 15),
        ("-0x80", "int8", -128),
        ("017", "int8", 17),
        ("1_000", "int32", 1000),
        ("18446744073709551615", "uint64", 2**64 - 1),
        ("1e3", "float32", 1000.0),
        ("-inf", "float64", -math.inf),
        ("", "string", ""),
        ("it's", "string", "it's"),
        ('"', "string", ""),
        ("'a\"b'", "string", 'a"b'),
        (r'"a\"b"', "string", 'a"b'),
        ("a,b", "wstring", "a,b"),
    ],
)
def test_a_literal_has_its_official_value(text, base, value):
    read = parse_scalar(text, base)
    assert (type(read), read) == (type(value), value)


@pytest.mark.parametrize(
    ("text", "base"),
    [
        ("yes", "bool"),
        ("256", "byte"),
        ("-1", "char"),
        ("1.0", "int8"),
        ("", "int8"),
        ("0x10", "float32"),
        ("9" * 5000, "int64"),
        ('"a"b"', "string"),
        ("0", "time"),
    ],
)
def test_invalid_value_of_a_type_is_refused(text, base):
    with pytest.raises(InvalidText):
        parse_scalar(text, base)


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("[]", "uint8[]", ()),
        ("[1, 2]", "uint8[2]", (1, 2)),
        ("[\"a,b\", c,'d']", "string[]", ("a,b", "c", "d")),
        (r'["a\"b\"c", ""]', "string[]", ('a"b"c', "")),
        ('["a",]', "string[]", ("a",)),
        ("[1]", "float64[<=2]", (1.0,)),
    ],
)
def test_an_array_has_its_official_value(text, kind, value):
    assert parse_default(text, parse_type(kind, "my_msgs")) == value


@pytest.mark.parametrize(
    ("text", "kind", "offset"),
    [
        ("1, 2", "uint8[]", 0),
        ("[1, 2]", "uint8[3]", 0),
        ("[1, 2]", "uint8[<=1]", 0),
        ("[1,  x]", "uint8[]", 5),
        ("[ ]", "uint8[]", 2),
        ('["a", ]', "string[]", 6),
        ('["a", "bcd"]', "string<=2[]", 6),
        ("{}", "Point", 0),
        ("[]", "Point[]", 0),
    ],
)
def test_a_wrong_array_is_refused_at_the_wrong_place(text, kind, offset):
    with pytest.raises(InvalidText) as caught:
        parse_default(text, parse_type(kind, "my_msgs"))
    assert caught.value.offset == offset


@pytest.mark.parametrize("text", [r"\ud800", r'"a\\\udfff"', r"'\ud83d\ude00'", r"\U0000dc00"])
def test_escape_of_a_lone_surrogate_is_refused(text):
    for type_text, value in (("string", text), ("wstring", text), ("string[]", f"[{text}]")):
        with pytest.raises(InvalidText, match="got the lone surrogate"):
            parse_default(value, parse_type(type_text, "my_msgs"))


@pytest.mark.parametrize("text", [r"\ud7ff\ue000", r"\\ud800", r"\U0001f600", r"\ud8"])
def test_other_escapes_and_escaped_backslashes_are_accepted(text):
    assert parse_default(text, parse_type("string", "my_msgs")) == text


def test_escapes_are_resolved_for_classes_and_unknown_ones_stay():
    assert unescape(r"a\tb\u0041\x41\\") == "a\tbAA\\"
    assert unescape(r"C:\dir \U99999999") == r"C:\dir \U99999999"
