"""The schemas of recorded topics: every bundled type, in both forms of a service's events."""

from __future__ import annotations

import pytest

import srvgen
from srvgen.classes.loader import search
from taskrpc.observe.recording.schemas import class_from, is_event, schema_text

ROBOT_TASK = "my_robot_interfaces/srv/RobotTask"


def event_class(service):
    return srvgen.load(service).Event


def test_message_is_followed_by_its_nested_types_under_rules():
    text = schema_text("geometry_msgs/msg/PoseStamped", search())
    own, *nested = text.split("\n" + "=" * 80 + "\n")
    assert "std_msgs/Header header" in own
    assert [each.splitlines()[0] for each in nested] == [
        "MSG: builtin_interfaces/msg/Time",
        "MSG: std_msgs/msg/Header",
        "MSG: geometry_msgs/msg/Point",
        "MSG: geometry_msgs/msg/Quaternion",
        "MSG: geometry_msgs/msg/Pose",
    ]


def test_event_of_a_service_has_its_request_and_response():
    text = schema_text(f"{ROBOT_TASK}_Event", search())
    assert text.startswith("service_msgs/ServiceEventInfo info\n")
    assert "my_robot_interfaces/RobotTask_Request[<=1] request\n" in text
    assert "MSG: my_robot_interfaces/RobotTask_Response\nbool success\n" in text


@pytest.mark.parametrize("package", ["test_msgs", "taskrpc_interfaces", "geometry_msgs"])
def test_class_from_a_schema_has_the_hash_of_the_type(package):
    for name in search().interfaces(package):
        if "/action/" in name:
            continue
        is_service = "/srv/" in name
        recorded = f"{name}_Event" if is_service else name
        expected = event_class(name) if is_service else srvgen.load(name)
        assert class_from(recorded, schema_text(recorded, search()))._HASH == expected._HASH


@pytest.mark.parametrize("part", ["SendGoal_Event", "GetResult_Event", "FeedbackMessage"])
def test_the_parts_of_an_action_are_written_with_their_fields(part):
    name = f"example_interfaces/action/Fibonacci_{part}"
    text = schema_text(name, search())
    assert "---" not in text
    assert "MSG: unique_identifier_msgs/msg/UUID" in text
    assert class_from(name, text) is srvgen.load(name)
    assert is_event(name) == part.endswith("_Event")


def test_event_schema_as_rosbag2_writes_it_is_read():
    own = search().text("example_interfaces/srv/AddTwoInts")
    text = "=" * 80 + f"\nSRV: example_interfaces/srv/AddTwoInts\n{own}"
    cls = class_from("example_interfaces/srv/AddTwoInts_Event", text)
    assert cls._HASH == event_class("example_interfaces/srv/AddTwoInts")._HASH


def test_nested_types_without_their_folder_are_read():
    text = "other/Part[] parts\n" + "=" * 80 + "\nMSG: other/Part\nint32 x\n"
    cls = class_from("mine/msg/Whole", text)
    assert cls.get_fields_and_field_types() == {"parts": "sequence<other/Part>"}


def test_event_schema_without_its_request_names_what_is_missing():
    with pytest.raises(srvgen.DefinitionError, match="expected the definition of a/srv/B_Request"):
        class_from("a/srv/B_Event", "service_msgs/ServiceEventInfo info\n")


@pytest.mark.parametrize(
    ("name", "expected"),
    [("a/srv/B_Event", True), ("a/msg/B_Event", False), ("a/srv/B", False), ("", False)],
)
def test_events_are_recognised_by_their_type(name, expected):
    assert is_event(name) is expected
