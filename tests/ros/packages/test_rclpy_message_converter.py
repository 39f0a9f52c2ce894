"""Messages as dicts and JSON."""

import importlib
import json

import pytest


@pytest.fixture
def converter(ros_names):
    return importlib.import_module("rclpy_message_converter.message_converter")


@pytest.fixture
def json_converter(ros_names):
    return importlib.import_module("rclpy_message_converter.json_message_converter")


POSES = {
    "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "map"},
    "poses": [
        {
            "position": {"x": 1.0, "y": 2.0, "z": 3.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        }
    ],
}


def test_dict_and_message_have_the_same_values(converter):
    message = converter.convert_dictionary_to_ros_message("geometry_msgs/msg/PoseArray", POSES)
    assert message.poses[0].position.y == 2.0
    assert converter.convert_ros_message_to_dictionary(message) == POSES
    same = converter.convert_dictionary_to_ros_message(type(message), POSES)
    assert same == message


def test_arrays_become_lists(converter):
    scan = importlib.import_module("sensor_msgs.msg").LaserScan(ranges=[1.0, 2.0])
    made = converter.convert_ros_message_to_dictionary(scan)
    assert (made["ranges"], type(made["ranges"])) == ([1.0, 2.0], list)


def test_request_and_response_of_a_service(converter):
    convert = converter.convert_dictionary_to_ros_message
    request = convert("std_srvs/srv/SetBool", {"data": True}, "request")
    assert type(request).__name__ == "SetBool_Request"
    assert convert("std_srvs/srv/SetBool", {"message": "ok"}, "response").message == "ok"
    with pytest.raises(ValueError, match='Unknown kind "feedback"'):
        convert("std_srvs/srv/SetBool", {}, "feedback")


@pytest.mark.parametrize(
    ("kind", "values", "problem"),
    [
        ("std_msgs/msg/String", {"data": 5}, r"data: expected string, got 5 \(int\)"),
        ("geometry_msgs/msg/Twist", {"linear": {"x": "1"}}, "linear.x: expected float64, got '1'"),
        ("geometry_msgs/msg/Twist", {"linear": 1}, "linear: expected geometry_msgs/msg/Vector3"),
        ("geometry_msgs/msg/Twist", None, "expected a dict .* got NoneType"),
    ],
)
def test_value_of_another_type_is_an_error(converter, kind, values, problem):
    with pytest.raises((TypeError, ValueError), match=problem):
        converter.convert_dictionary_to_ros_message(kind, values)


def test_types_are_not_checked_on_request(converter):
    convert = converter.convert_dictionary_to_ros_message
    assert convert("std_msgs/msg/String", {"data": 5}, check_types=False).data == 5


def test_unknown_and_missing_fields_are_errors_or_ignored(converter):
    convert = converter.convert_dictionary_to_ros_message
    said = 'ROS message type "std_msgs/msg/String" has no field named "dada"'
    with pytest.raises(ValueError, match=said):
        convert("std_msgs/msg/String", {"dada": "a"})
    assert convert("std_msgs/msg/String", {"dada": "a"}, strict_mode=False).data == ""
    with pytest.raises(ValueError, match=r"Missing fields: \['data'\]"):
        convert("std_msgs/msg/String", {}, check_missing_fields=True)


def test_time_now_is_the_current_time(converter):
    made = converter.convert_dictionary_to_ros_message(
        "std_msgs/msg/Header", {"stamp": "now", "frame_id": "now"}
    )
    assert made.stamp.sec > 1_700_000_000
    assert made.frame_id == "now"


def test_json_and_message_have_the_same_values(json_converter):
    message = json_converter.convert_json_to_ros_message(
        "geometry_msgs/msg/PoseArray", json.dumps(POSES)
    )
    assert json.loads(json_converter.convert_ros_message_to_json(message)) == POSES
    byte = importlib.import_module("std_msgs.msg").Byte(data=b"\1")
    assert json_converter.convert_ros_message_to_json(byte) == '{"data": "AQ=="}'
