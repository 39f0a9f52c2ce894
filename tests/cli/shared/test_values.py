"""A request is read with the types of its fields; no value is guessed or cut off."""

from __future__ import annotations

import contextlib
import math
import struct

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.cli.shared.values import (
    as_typed,
    build_request,
    simple_mapping,
    simple_value,
    split_type,
)
from taskrpc.cli.shared.yaml_values import Reader, read_mapping
from taskrpc.errors import InvalidRequest

ADD = srvgen.load("example_interfaces/srv/AddTwoInts").Request
TASK = srvgen.load("my_robot_interfaces/srv/RobotTask").Request
PLAN = srvgen.load("nav_msgs/srv/GetPlan").Request
BASIC = srvgen.load("test_msgs/srv/BasicTypes").Request
ARRAYS = srvgen.load("test_msgs/srv/Arrays").Request
POINT = srvgen.load("geometry_msgs/msg/Point")
POINT32 = srvgen.load("geometry_msgs/msg/Point32")
TRIGGER = srvgen.load("std_srvs/srv/Trigger").Request


def refusal(cls, *argv: str) -> str:
    with pytest.raises(InvalidRequest) as caught:
        build_request(cls, argv)
    return "\n".join([str(caught.value), *getattr(caught.value, "__notes__", ())])


@pytest.mark.parametrize(
    ("arguments", "type_name"),
    [
        (["example_interfaces/srv/AddTwoInts", "a=1"], "example_interfaces/srv/AddTwoInts"),
        (["example_interfaces/AddTwoInts"], "example_interfaces/AddTwoInts"),
        (["a=1"], ""),
        (["{a: 1}"], ""),
        (["target=a/b"], ""),
        (["/a/b"], ""),
        (["a/b/c/d"], ""),
        ([], ""),
    ],
)
def test_only_two_or_three_names_with_slashes_are_a_type(arguments, type_name):
    assert split_type(arguments) == (type_name, arguments[bool(type_name) :])


def test_merge_keys_add_missing_fields_of_a_mapping():
    assert build_request(ADD, ["{<<: {a: 2, b: 1}, b: 3}"]) == ADD(a=2, b=3)


@pytest.mark.parametrize("text", ["{x: !!float 10}", "{x: !!int 10}", "x: 10"])
def test_tag_sets_the_type_of_a_number(text):
    assert build_request(POINT, [text]) == POINT(x=10.0)


@pytest.mark.parametrize("argv", [[], [""], ["{}"], ["  "], ["# nothing"]])
def test_without_values_a_request_has_its_defaults(argv):
    assert build_request(ADD, argv) == ADD()


@pytest.mark.parametrize(
    "argv",
    [["{a: 2, b: 3}"], ["a: 2\nb: 3"], ["a=2", "b=3"], ['{"a": 2, "b": 3}'], ["{a: +2, b: 3}"]],
)
def test_the_same_request_in_every_notation(argv):
    assert build_request(ADD, argv) == ADD(a=2, b=3)


@pytest.mark.parametrize(
    "text", ["on", "3,4", "007", "null", "~", "1e3", "2024-01-01", "a: b", "", "'x'"]
)
def test_a_string_field_takes_a_value_literally(text):
    assert build_request(TASK, [f"target={text}"]).target == text


@pytest.mark.parametrize("text", ["on", "007", "null", "~", "1e3", "2024-01-01", "3"])
def test_a_string_field_takes_a_plain_yaml_scalar_literally(text):
    assert build_request(TASK, [f"{{target: {text}}}"]).target == text


@given(st.text(st.characters(exclude_categories=["Cs", "Cc"])))
def test_any_quoted_yaml_string_arrives_as_it_is(text):
    written = yaml.safe_dump({"target": text}, default_style='"', allow_unicode=False)
    assert build_request(TASK, [written]).target == text


@given(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1))
def test_every_integer_in_range_arrives(a, b):
    assert build_request(ADD, [f"a={a}", f"b={b}"]) == ADD(a=a, b=b)
    assert build_request(ADD, [f"{{a: {a}, b: {b}}}"]) == ADD(a=a, b=b)


@given(st.text(max_size=30))
def test_any_text_is_a_request_or_is_refused(text):
    with contextlib.suppress(InvalidRequest):
        assert type(build_request(ADD, [text])) is ADD


@pytest.mark.parametrize("text", ["1e3", "1000", "1.0e+3", "1_000"])
def test_float_may_be_written_in_common_notations(text):
    assert build_request(BASIC, [f"float64_value={text}"]).float64_value == 1000.0


def test_nan_and_infinity_are_read_as_floats():
    assert math.isnan(build_request(BASIC, ["float64_value=nan"]).float64_value)
    assert build_request(BASIC, ["{float64_value: -.inf}"]).float64_value == -math.inf


@pytest.mark.parametrize(("text", "value"), [("true", True), ("no", False), ("1", True)])
def test_booleans(text, value):
    assert build_request(BASIC, [f"bool_value={text}"]).bool_value is value


def test_dots_reach_into_nested_messages():
    request = build_request(
        PLAN, ["start.pose.position.x=1", "goal={pose: {position: {y: 2}}}", "tolerance=1e-1"]
    )
    assert request.start.pose.position.x == 1.0
    assert request.goal.pose.position.y == 2.0
    assert request.goal.pose.orientation.w == 1.0, "what is not named keeps its default"


def test_arrays_are_written_in_brackets_and_strings_in_them_are_literal():
    request = build_request(ARRAYS, ["string_values=[on, 007, x]", "int8_values=[1, 2, 3]"])
    assert request.string_values == ["on", "007", "x"]
    assert request.int8_values == [1, 2, 3]


@pytest.mark.parametrize(
    ("cls", "argv", "message"),
    [
        (ADD, ["{a: 2.5}"], "Failed to populate field: a: expected int64, got 2.5 (float)"),
        (ADD, ["a=1.0"], "a: expected int64, got 1.0 (float)"),
        (ADD, ["{a: x}"], "Failed to populate field: a: expected int64, got 'x' (str)"),
        (ADD, [f"a={2**63}"], "a: expected int64 in -9223372036854775808..9223372036854775807"),
        (
            ADD,
            ["{a: 2, c: 3}"],
            "'AddTwoInts_Request' object has no attribute 'c'\nAddTwoInts_Request has a, b",
        ),
        (ADD, ["a="], "a: expected int64, got nothing"),
        (ADD, ["a=1", "a=2"], "a: given twice"),
        (ADD, ["{a: 1, a: 2}"], "a: given twice"),
        (ADD, ["a.x=1"], "a: expected int64"),
        (ADD, ["[1,2]"], "Value '[1, 2]' is expected to be a dictionary but is a list"),
        (ADD, ["7"], "Value '7' is expected to be a dictionary but is a int"),
        (ADD, ["AddTwoInts"], "a type is written as example_interfaces/srv/AddTwoInts"),
        (ADD, ["a=1", "{b: 2}"], "expected one YAML text, or only FIELD=VALUE"),
        (ADD, ["a: 1, b: 2"], "put several fields on one line in braces"),
        (ADD, ["{a: 1}\n---\n{b: 2}"], "expected a single document"),
        (ADD, ["!!python/name:os.system"], "could not determine a constructor"),
        (ADD, ["&x {a: *x}"], "an anchor that contains it"),
        (ADD, ["a: \x07"], "special characters are not allowed"),
        (TASK, ["task_typ=move"], "did you mean task_type?"),
        (
            PLAN,
            ["start.pose.positon.x=1"],
            "'Pose' object has no attribute 'positon'\nPose has position, orientation; did",
        ),
        (PLAN, ["start.pose=1", "start.pose.position.x=1"], "given twice"),
        (PLAN, ["start=1"], "start: expected the fields of geometry_msgs/msg/PoseStamped"),
        (PLAN, ["{start: {pose: {position: {x: hi}}}}"], "start.pose.position.x: expected float64"),
        (BASIC, ["uint8_value=300"], "uint8_value: expected uint8 in 0..255, got 300"),
        (ARRAYS, ["int8_values=[1, 2, x]"], "int8_values[2]: expected int8, got 'x' (str)"),
        (ARRAYS, ["int8_values=[1, 2]"], "int8_values: expected 3 elements, got 2"),
        (ARRAYS, ["int8_values=1"], "int8_values: expected a list, got 1 (int)"),
        (TRIGGER, ["x=1"], "Trigger_Request has no fields"),
    ],
)
def test_invalid_request_is_refused_with_the_path_of_its_field(cls, argv, message):
    assert message in refusal(cls, *argv)


def test_broken_yaml_is_shown_with_a_caret():
    assert refusal(ADD, "{a: 1") == (
        "the request is not valid YAML: expected ',' or '}', but got '<stream end>'\n"
        "    {a: 1\n"
        "         ^"
    )


WORDS = st.from_regex(r"[-+]?[0-9a-zA-Z_./:+-]{0,8}", fullmatch=True) | st.sampled_from(
    "0 -0 00 007 1_000 0x1F 0b1 -5 +5 1e3 1.5 -1.5 .5 5. 1:30 true True yes on off null ~ - -- a- "
    "2001-01-01 2001-01-01T00 nan .nan .inf = <<".split()
)
TYPES = st.sampled_from(
    "string wstring string<=5 bool byte char int8 int64 float32 float64".split()
)


@given(word=WORDS, type_=TYPES)
def test_value_read_without_yaml_equals_the_yaml_value(word, type_):
    value = simple_value(word, type_)
    if value is not None:
        reader = Reader(word)
        expected = reader.value(reader.node, type_, None)
        assert (type(value), repr(value)) == (type(expected), repr(expected))


@given(
    pairs=st.lists(
        st.tuples(
            st.sampled_from(
                ["bool_value", "int32_value", "float64_value", "string_value", "none", "", "? a"]
            ),
            WORDS,
        ),
        max_size=4,
    ),
    comma=st.sampled_from([", ", ",", " , ", "\n, "]),
)
def test_mapping_read_without_yaml_equals_the_yaml_mapping(pairs, comma):
    text = "{" + comma.join(f"{name}: {word}" for name, word in pairs) + "}"
    fields = simple_mapping(BASIC, text)
    if fields is not None:
        assert repr(fields) == repr(read_mapping(BASIC, text, ""))


@pytest.mark.parametrize(
    ("cls", "text"),
    [(ADD, "{a: 2, b: -3}"), (TASK, "{task_type: move, target: dock, priority: 8}")],
)
def test_the_usual_requests_are_read_without_yaml(cls, text):
    assert simple_mapping(cls, text) is not None


@pytest.mark.parametrize(
    ("argv", "hint"),
    [
        (["task_type:=move"], "task_type:= is for parameters and remappings; write task_type=move"),
        (["priority:=3", "target:=dock"], "write priority=3 target=dock"),
        (["task_type=move,", "priority=2"], "write task_type=move priority=2"),
        (["task_type=move, priority=2"], "write task_type=move priority=2"),
    ],
)
def test_wrong_separator_between_fields_gets_a_hint(argv, hint):
    assert hint in refusal(TASK, *argv)


def test_a_comma_in_a_text_is_part_of_it():
    assert build_request(TASK, ["target=3,4", "task_type=a, b"]) == TASK(
        target="3,4", task_type="a, b"
    )


@given(st.floats(width=32))
def test_float32_numbers_are_shown_with_few_digits_and_the_same_value(number):
    shown = as_typed(POINT32(x=number))
    assert struct.pack("<f", shown.x) == struct.pack("<f", number)
    assert len(repr(shown.x)) <= len(repr(number))


def test_float32_numbers_are_shown_as_they_were_typed():
    point = build_request(POINT32, ["{x: 0.2, y: 1.57, z: -3.4028235e38}"])
    assert point.x != 0.2
    cloud = srvgen.load("sensor_msgs/msg/PointCloud")(points=[point])
    shown = as_typed(cloud).points[0]
    assert (shown.x, shown.y, shown.z) == (0.2, 1.57, -3.4028235e38)
    assert cloud.points[0].x == point.x
    assert as_typed(POINT32(x=math.inf)).x == math.inf
