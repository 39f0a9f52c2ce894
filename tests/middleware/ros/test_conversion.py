"""Messages between our classes and classes as ROS generates them."""

from __future__ import annotations

import pytest

import srvgen
from taskrpc.middleware.ros import conversion
from tests.middleware.ros import fake_ros

TYPES = [
    "test_msgs/msg/BasicTypes",
    "test_msgs/msg/Arrays",
    "test_msgs/msg/BoundedSequences",
    "test_msgs/msg/UnboundedSequences",
    "test_msgs/msg/Nested",
    "test_msgs/msg/MultiNested",
    "test_msgs/msg/Strings",
    "test_msgs/msg/WStrings",
    "test_msgs/msg/Defaults",
    "test_msgs/msg/Constants",
    "test_msgs/msg/Empty",
    "geometry_msgs/msg/PoseStamped",
]


@pytest.fixture(autouse=True)
def _classes_of_ros(monkeypatch):
    monkeypatch.setattr(conversion, "message_class", fake_ros.ros_message)
    conversion.to_ros.cache_clear()
    conversion.from_ros.cache_clear()


@pytest.mark.parametrize("type_name", TYPES)
def test_message_is_equal_after_both_conversions(type_name):
    ours, ros = srvgen.load(type_name), fake_ros.ros_message(type_name)
    message = ours()
    back = conversion.from_ros(ours, ros)(conversion.to_ros(ours, ros)(message))
    back._check()
    assert back == message


def test_values_of_all_kinds_arrive():
    name = "test_msgs/msg/UnboundedSequences"
    ours, ros = srvgen.load(name), fake_ros.ros_message(name)
    inner = srvgen.load("test_msgs/msg/BasicTypes")
    message = ours(
        bool_values=[True, False],
        byte_values=[b"\x01", b"\xff"],
        uint8_values=b"\x00\x80",
        float64_values=[1.5, -2.0],
        string_values=["ä", ""],
        basic_types_values=[inner(int8_value=-3)],
    )
    made = conversion.to_ros(ours, ros)(message)
    assert made.bool_values == [True, False]
    assert made.byte_values == [b"\x01", b"\xff"]
    assert made.uint8_values.tolist() == [0, 128]
    assert made.float64_values.typecode == "d"
    assert type(made.basic_types_values[0]) is fake_ros.ros_message("test_msgs/msg/BasicTypes")
    assert conversion.from_ros(ours, ros)(made) == message


def test_arrays_are_copies():
    name = "test_msgs/msg/UnboundedSequences"
    ours, ros = srvgen.load(name), fake_ros.ros_message(name)
    message = ours(float64_values=[1.0])
    made = conversion.to_ros(ours, ros)(message)
    message.float64_values[0] = 2.0
    assert made.float64_values.tolist() == [1.0]
