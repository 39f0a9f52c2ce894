"""JSON Schemas of messages, and the descriptions that agents read."""

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

import srvgen
from taskrpc.bridges.mcp.arguments import DRY_RUN, REQUEST_ID
from taskrpc.bridges.mcp.results import json_of
from taskrpc.bridges.mcp.schemas import (
    Definitions,
    description,
    input_schema,
    output_schema,
    plain_text,
)

DEFINITION = """\
# Moves the arm.
#   Slowly.
int8 FAST = 1
int8 SLOW = 2
int8 speed 2        # how fast [m/s]
uint8 MODE_A = 0
uint8 MODE_B = 7
uint8 mode
uint8 other
string name "arm"   # a name
float64[3] start
geometry_msgs/Pose[<=2] poses
---
# What came of it.
bool success        # whether it moved
float32 seconds
uint8[] image
byte[] raw
geometry_msgs/Point point
"""
MOVE = srvgen.define("agent_msgs/srv/Move", DEFINITION)
TEXTS = Definitions(MOVE._TYPE, MOVE._DEFINITION)
REQUEST, RESPONSE = TEXTS.sections
INPUT = input_schema(MOVE.Request, REQUEST, TEXTS)
OUTPUT = output_schema(MOVE.Response, RESPONSE, TEXTS)


@pytest.mark.parametrize(
    ("field", "expected"),
    [
        (
            "speed",
            {
                "type": "integer",
                "minimum": -128,
                "maximum": 127,
                "default": 2,
                "description": "how fast [m/s] Constants: FAST = 1, SLOW = 2",
                "examples": [1, 2],
            },
        ),
        (
            "mode",
            {
                "type": "integer",
                "minimum": 0,
                "maximum": 255,
                "default": 0,
                "description": "Constants: MODE_A = 0, MODE_B = 7",
                "examples": [0, 7],
            },
        ),
        ("other", {"type": "integer", "minimum": 0, "maximum": 255, "default": 0}),
        ("name", {"type": "string", "default": "arm", "description": "a name"}),
        (
            "start",
            {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
        ),
        (
            "poses",
            {"type": "array", "items": {"$ref": "#/$defs/geometry_msgs.msg.Pose"}, "maxItems": 2},
        ),
    ],
)
def test_field_of_a_request_has_this_schema(field, expected):
    assert INPUT["properties"][field] == expected


def test_nested_messages_are_described_once():
    assert set(INPUT["$defs"]) == {
        "geometry_msgs.msg.Pose",
        "geometry_msgs.msg.Point",
        "geometry_msgs.msg.Quaternion",
    }
    quaternion = INPUT["$defs"]["geometry_msgs.msg.Quaternion"]
    assert quaternion["properties"]["w"]["default"] == 1.0


def test_schema_carries_the_comment_and_refuses_other_fields():
    assert INPUT["description"] == "Moves the arm. Slowly."
    assert INPUT["additionalProperties"] is False
    assert "required" not in INPUT


def test_comment_that_is_only_a_heading_is_left_out():
    cls = srvgen.load("my_robot_interfaces/srv/RobotTask")
    texts = Definitions(cls._TYPE, cls._DEFINITION)
    assert [description(each) for each in texts.sections] == ["", ""]


def test_response_has_all_fields_and_null_for_nan():
    assert OUTPUT["required"] == ["success", "seconds", "image", "raw", "point"]
    assert OUTPUT["properties"]["seconds"] == {"type": ["number", "null"]}
    assert OUTPUT["properties"]["image"] == {"type": "string", "contentEncoding": "base64"}
    assert OUTPUT["properties"]["success"] == {
        "type": "boolean",
        "description": "whether it moved",
    }


@given(st.floats(width=32), st.binary(max_size=4), st.floats())
def test_every_response_fits_its_schema(seconds, data, x):
    fields = {"seconds": seconds, "image": list(data), "raw": list(data), "point": {"x": x}}
    value = json_of(srvgen.from_builtins(MOVE.Response, fields))
    Draft202012Validator(OUTPUT).validate(value)
    assert json.loads(msgspec.json.encode(value)) == value


def test_arguments_of_the_tool_are_added_to_the_request():
    schema = input_schema(MOVE.Request, REQUEST, TEXTS, [REQUEST_ID, DRY_RUN])
    assert [name for name in schema["properties"] if name.startswith("_")] == [REQUEST_ID, DRY_RUN]
    Draft202012Validator.check_schema(schema)


def test_deeply_nested_types_make_a_schema_of_linear_size():
    text = "Level1 a\nLevel1 b\n---\n"
    levels = 40
    for number in range(1, levels):
        text += f"\n{'=' * 80}\nMSG: deep_msgs/msg/Level{number}\n"
        below = f"Level{number + 1}"
        text += "int8 a\n" if number == levels - 1 else f"{below}[] a\n{below}[] b\n"
    cls = srvgen.define("deep_msgs/srv/Deep", text)
    texts = Definitions(cls._TYPE, cls._DEFINITION)
    schema = input_schema(cls.Request, texts.sections[0], texts)
    assert len(schema["$defs"]) == levels - 1


def test_sections_of_an_action_are_goal_result_and_feedback():
    cls = srvgen.load("example_interfaces/action/Fibonacci")
    sections = Definitions(cls._TYPE, cls._DEFINITION).sections
    assert [each.fields[0].name for each in sections] == ["order", "sequence", "sequence"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("plain", "plain"),
        ("two\nlines", "two lines"),
        ("\x1b[31mred\x07", "[31mred"),
        ("left\u202eright", "left right"),
        ("x" * 1001, "x" * 1000 + "…"),
    ],
)
def test_text_of_another_program_is_one_harmless_line(text, expected):
    assert plain_text(text) == expected
