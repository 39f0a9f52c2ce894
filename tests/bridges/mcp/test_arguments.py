"""Requests from JSON: what the converter accepts, and what it says of the rest."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

import srvgen
from srvgen import FieldError
from taskrpc.bridges.mcp.arguments import DRY_RUN, REQUEST_ID, message_of, split
from taskrpc.bridges.mcp.schemas import Definitions, input_schema

ALL = srvgen.define(
    "agent_msgs/srv/All",
    """\
int8 i8
uint8 u8
int16 i16
uint16 u16
int32 i32
uint32 u32
int64 i64
uint64 u64
byte octet
char letter
bool flag
float64 real
string text
string<=3 short
wstring<=2 wide
int16[<=2] few
float64[2] pair
bool[] flags
string<=2[<=2] words
uint8[3] three
byte[<=2] bytes
geometry_msgs/Point point
geometry_msgs/Point32[<=1] points
---
""",
)
TEXTS = Definitions(ALL._TYPE, ALL._DEFINITION)
SCHEMA = input_schema(ALL.Request, TEXTS.sections[0], TEXTS)
VALIDATOR = Draft202012Validator(SCHEMA)
BYTES = ("three", "bytes")
"""Fields that also accept base64, about whose contents a schema says nothing."""

WHOLE = sorted(
    {
        sign * 2**bits + more
        for bits in (0, 7, 8, 15, 16, 31, 32, 63, 64)
        for sign in (-1, 1)
        for more in (-1, 0, 1)
    }
)
EDGES = (
    *WHOLE,
    *map(float, WHOLE),
    *(None, True, False, 0.5, -2.5, {}, {"x": 1}, {"x": None}, {"w": 1}, "5", "", [], [[]], [{}]),
    *("x" * length for length in range(1, 5)),
    *([1] * length for length in range(5)),
    *([item, item] for item in (True, None, 0.5, "", "abc", "ab", 1.0, 300, 40_000, {"x": 1})),
)
"""Values at the limits of types and bounds, and of each type of JSON."""
ONE = (
    st.none()
    | st.booleans()
    | st.integers(-(2**65), 2**65)
    | st.floats(-1e6, 1e6)
    | st.text(max_size=4)
    | st.dictionaries(st.sampled_from("xyzw"), st.floats(-9, 9) | st.none(), max_size=3)
)
VALUES = ONE | st.lists(ONE, max_size=4) | st.lists(st.integers(-300, 300), max_size=4)
FIELDS = [*(name for name, _ in ALL.Request._FIELDS), "unknown"]


def is_converted(fields):
    try:
        message_of(ALL.Request, fields)
    except FieldError:
        return False
    return True


def check(name, value):
    if not (name in BYTES and isinstance(value, str)):
        assert VALIDATOR.is_valid({name: value}) == is_converted({name: value}), (name, value)


@pytest.mark.parametrize("name", FIELDS)
def test_schema_accepts_exactly_what_is_converted_at_the_limits(name):
    for value in EDGES:
        check(name, value)


@given(st.sampled_from(FIELDS), VALUES)
def test_schema_accepts_exactly_what_is_converted(name, value):
    check(name, value)


def test_schema_is_valid_json_schema():
    Draft202012Validator.check_schema(SCHEMA)
    assert json.loads(json.dumps(SCHEMA)) == SCHEMA


def test_missing_fields_have_their_defaults():
    assert message_of(ALL.Request, {}) == ALL.Request()


def test_whole_float_is_an_integer_and_base64_is_bytes():
    message = message_of(ALL.Request, {"u8": 2.0, "three": "AQID", "point": {"x": 1}})
    assert (message.u8, list(message.three), message.point.x) == (2, [1, 2, 3], 1.0)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"i32": "5"}, 'i32: expected int32, got "5"'),
        ({"i32": True}, "i32: expected int32, got true"),
        ({"i32": 2.5}, "i32: expected int32, got 2.5"),
        ({"i8": 128}, "i8: expected int8 in -128..127, got 128"),
        ({"flag": 1}, "flag: expected true or false, got 1"),
        ({"real": None}, "real: expected float64, got null"),
        ({"short": "abcd"}, "short: expected at most 3 characters, got 4"),
        ({"few": [1, 2, 3]}, "few: expected at most 2 elements, got 3"),
        ({"few": 1}, "few: expected a list, got 1"),
        ({"words": ["a", 1]}, "words[1]: expected string, got 1"),
        ({"three": "?"}, "three: expected base64 text or a list of numbers"),
        ({"point": {"x": "1"}}, 'point.x: expected float64, got "1"'),
        ({"points": [{"w": 1}]}, "points[0].w: unknown field 'w'; Point32 has x, y, z"),
        ({"point": 1}, "point: expected an object with the fields of geometry_msgs/msg/Point"),
        ({"i3": 1}, "i3: unknown field 'i3'; All_Request has"),
        ({"text": 1}, "text: expected string, got 1"),
    ],
)
def test_wrong_value_is_refused_with_its_field_and_what_was_expected(fields, problem):
    with pytest.raises(FieldError) as refused:
        message_of(ALL.Request, fields)
    assert str(refused.value).startswith(problem)


def test_long_value_is_shown_in_part():
    with pytest.raises(FieldError, match="…") as refused:
        message_of(ALL.Request, {"i32": "x" * 10_000})
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("field", ["text", "i32"])
def test_integer_too_long_to_print_is_refused(field):
    with pytest.raises(FieldError, match="a far larger number"):
        message_of(ALL.Request, {field: 10**5000})


def test_arguments_of_the_tool_are_taken_out():
    found = split({"a": 1, REQUEST_ID: "monday-1", DRY_RUN: True})
    assert (found.fields, found.request_id, found.is_dry_run) == ({"a": 1}, "monday-1", True)


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({REQUEST_ID: 5}, "_request_id: expected a text that is not empty, got 5"),
        ({REQUEST_ID: ""}, '_request_id: expected a text that is not empty, got ""'),
        ({REQUEST_ID: "x" * 201}, "_request_id: expected at most 200 characters, got 201"),
        ({DRY_RUN: "yes"}, '_dry_run: expected true or false, got "yes"'),
    ],
)
def test_wrong_argument_of_the_tool_is_refused(given, problem):
    with pytest.raises(FieldError) as refused:
        split(given)
    assert str(refused.value) == problem
