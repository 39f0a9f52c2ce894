"""Values of parameters from YAML have the types of ROS."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.ros.packages.rclpy._impl.arguments import (
    parse,
)
from taskrpc.ros.packages.rclpy._impl.parameters.yaml_parameters import read_file, read_value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-7", -7),
        ("010", 8),
        ("0x1F", 31),
        ("1e3", 1000.0),
        ("1.", 1.0),
        (".5", 0.5),
        ("-.inf", -math.inf),
        ("9223372036854775808", 9223372036854775808.0),
        ("true", True),
        ("Y", True),
        ("off", False),
        ("buzz", "buzz"),
        ("'1'", "1"),
        ("!!str 1", "1"),
        ("!!float 10", 10.0),
        ("!!float '10'", 10.0),
        ("&a !!float 10", 10.0),
        ("!!int 5", 5),
        ("!!bool yes", True),
        ("[!!float 1, 2.0]", [1.0, 2.0]),
        ("!!timestamp foo", "foo"),
        ("12:30", "12:30"),
        ("2026-01-01", "2026-01-01"),
        ("null", "null"),
        ("1_000", "1_000"),
        ("''", ""),
        ("[]", []),
        ("[1, 2]", [1, 2]),
        ("[a, 'b']", ["a", "b"]),
        ("[1.0, 2e0]", [1.0, 2.0]),
    ],
)
def test_values_have_ros_s_types(text, value):
    found = read_value(text)
    assert (found, type(found)) == (value, type(value))
    assert parse(["--ros-args", "-p", f"a.b:={text}"]).parameters == {"/**": {"a.b": value}}


@pytest.mark.parametrize("text", ["!!float abc", "!!int 1.5", "!!bool maybe", "[!!int x]"])
def test_a_value_that_contradicts_its_tag_is_refused(text):
    with pytest.raises(ValueError, match=r"Invalid value '\S+' for !!\w+ at line 1"):
        read_value(text)


def test_nan_is_a_number():
    assert math.isnan(read_value(".nan"))


@given(st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.booleans())
def test_what_python_writes_of_numbers_is_read_back(value):
    text = repr(value) if isinstance(value, float) else str(value).lower()
    assert read_value(text) == value
    assert type(read_value(text)) is type(value)


FILE = """\
/**:
  ros__parameters: {a: all, b: all}
/ns:
  robot:
    ros__parameters:
      a: mine
      group: {x: 1, deep: {y: [1.5]}}
/*/robot:
  ros__parameters:
    c: one
other:
  ros__parameters: {a: other}
"""


def test_a_file_has_nodes_in_namespaces_and_groups_of_parameters():
    assert read_file(FILE) == {
        "/**": {"a": "all", "b": "all"},
        "/ns/robot": {"a": "mine", "group.x": 1, "group.deep.y": [1.5]},
        "/*/robot": {"c": "one"},
        "other": {"a": "other"},
    }


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("robot: 5", "Cannot have a value before ros__parameters at line 1"),
        ("ros__parameters: {}", "No node names before ros__parameters at line 1"),
        ("r:\n  ros__parameters: 5", "Expected a map of parameters at line 2"),
        ("r:\n  ros__parameters:\n    a:", "No value at line 3"),
        ("r:\n  ros__parameters:\n    a: [[1]]", "Sequence cannot contain sequences or maps"),
        ("r:\n  ros__parameters:\n    [a]: 1", "Sequences can only be values and not keys in"),
        ("a: b: c", "Error parsing a event near line 1: mapping values are not allowed here"),
    ],
)
def test_mistakes_in_a_file_are_reported_with_their_line(text, problem):
    with pytest.raises(ValueError, match="line") as caught:
        read_file(text)
    assert str(caught.value).startswith(problem)
