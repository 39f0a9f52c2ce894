"""Messages to and from dicts, YAML and lines of values, as programs for ROS make them."""

from collections import OrderedDict

import pytest
import yaml

import srvgen
from taskrpc.ros.rosidl_runtime_py import (
    message_to_csv,
    message_to_ordereddict,
    message_to_yaml,
    set_message_fields,
)

PoseStamped = srvgen.load("geometry_msgs/msg/PoseStamped")
Log = srvgen.load("rcl_interfaces/msg/Log")
BasicTypes = srvgen.load("test_msgs/msg/BasicTypes")
Arrays = srvgen.load("test_msgs/msg/Arrays")
UnboundedSequences = srvgen.load("test_msgs/msg/UnboundedSequences")
Nested = srvgen.load("test_msgs/msg/Nested")
Time = srvgen.load("builtin_interfaces/msg/Time")


def test_a_message_is_a_dict_with_its_fields_in_order():
    found = message_to_ordereddict(PoseStamped())
    assert type(found) is OrderedDict
    assert list(found) == ["header", "pose"]
    assert type(found["pose"]) is OrderedDict
    assert found["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    numbers = message_to_ordereddict(UnboundedSequences(int32_values=[1, 2]))["int32_values"]
    assert (numbers, type(numbers)) == ([1, 2], list)


def test_a_message_is_yaml_in_order_and_on_one_line_where_that_is_wanted():
    message = Log(stamp=Time(sec=1), name="robot", msg="it's late")
    text = message_to_yaml(message)
    assert text.splitlines()[:3] == ["stamp:", "  sec: 1", "  nanosec: 0"]
    assert yaml.safe_load(text) == message_to_ordereddict(message)
    assert message_to_yaml(Time(sec=1), flow_style=True) == "{sec: 1, nanosec: 0}\n"


def test_a_byte_is_a_character_of_yaml_and_itself_between_commas():
    message = BasicTypes(byte_value=b"\1", bool_value=True)
    assert message_to_ordereddict(message)["byte_value"] == "\1"
    assert message_to_csv(message) == r"True,b'\x01',0,0.0,0.0,0,0,0,0,0,0,0,0"
    assert message_to_ordereddict(Arrays())["byte_values"] == ["\0"] * 3


def test_long_parts_are_cut_off():
    message = UnboundedSequences(int32_values=[1, 2, 3], string_values=["abc"])
    short = message_to_ordereddict(message, truncate_length=2)
    assert short["int32_values"] == [1, 2, "..."]
    assert short["string_values"] == ["ab..."]
    bare = message_to_ordereddict(message, no_arr=True)
    assert bare["int32_values"] == "<sequence type: int32, length: 3>"
    assert message_to_csv(Log(name="robot"), no_str=True).split(",")[3] == "<string length: <5>>"


def test_fields_are_set_and_the_others_stay():
    message = BasicTypes(int32_value=42, char_value=3)
    assert set_message_fields(message, {"bool_value": True, "char_value": "7"}) == []
    assert (message.bool_value, message.char_value, message.int32_value) == (True, 7, 42)


def test_messages_in_a_message_are_dicts_or_messages():
    message, values = (
        UnboundedSequences(),
        {"basic_types_values": [{"int8_value": 42}, BasicTypes()]},
    )
    for _ in range(2):
        set_message_fields(message, values)
        assert message.basic_types_values == [BasicTypes(int8_value=42), BasicTypes()]
    nested = Nested()
    set_message_fields(nested, {"basic_types_value": {"float64_value": 1}})
    assert nested.basic_types_value.float64_value == 1.0


@pytest.mark.parametrize(
    ("values", "kind", "problem"),
    [
        ({"nothing": 1}, AttributeError, "nothing"),
        ({"int32_value": "many"}, ValueError, "many"),
        ("all", TypeError, "Value 'all' is expected to be a dictionary but is a str"),
    ],
)
def test_a_wrong_value_is_refused(values, kind, problem):
    with pytest.raises(kind, match=problem):
        set_message_fields(BasicTypes(), values)


def test_now_and_auto_stand_for_a_time_where_that_is_allowed():
    message = PoseStamped()
    setters = set_message_fields(message, {"header": "auto"}, True, True)
    setters += set_message_fields(
        message, {"header": {"stamp": "now", "frame_id": "map"}}, True, True
    )
    setters[-1](Time(sec=2))
    assert (message.header.stamp.sec, message.header.frame_id, len(setters)) == (2, "map", 2)
    with pytest.raises(TypeError, match=r"^Value 'auto' is expected to be a dictionary"):
        set_message_fields(message, {"header": "auto"})
    with pytest.raises(TypeError, match=r"^Value 'now' is expected to be a dictionary"):
        set_message_fields(message, {"header": {"stamp": "now"}})
