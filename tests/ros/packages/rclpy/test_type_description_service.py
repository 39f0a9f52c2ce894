"""The service of every node that describes types."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.parameter import Parameter
from tests.ros.packages.rclpy.living import PATIENCE, living

pytestmark = pytest.mark.real_time

GetTypeDescription = srvgen.load("type_description_interfaces/srv/GetTypeDescription")
PoseStamped = srvgen.load("geometry_msgs/msg/PoseStamped")


def asked(**request):
    with living() as world:
        node = world.node()
        client = node.create_client(GetTypeDescription, "robot/get_type_description")
        assert client.wait_for_service(PATIENCE)
        return world.answer(client.call_async(GetTypeDescription.Request(**request)))


def test_description_contains_all_referenced_types():
    answer = asked(type_name=PoseStamped._TYPE, type_hash=PoseStamped._HASH)
    assert answer.successful
    described = answer.type_description.type_description
    assert described.type_name == "geometry_msgs/msg/PoseStamped"
    assert [field.name for field in described.fields] == ["header", "pose"]
    inside = answer.type_description.referenced_type_descriptions
    assert "geometry_msgs/msg/Quaternion" in [one.type_name for one in inside]
    assert answer.type_sources[0].type_name == "geometry_msgs/msg/PoseStamped"
    assert len(answer.type_sources) == len(inside) + 1


def test_the_sources_can_be_left_out():
    answer = asked(
        type_name=PoseStamped._TYPE, type_hash=PoseStamped._HASH, include_type_sources=False
    )
    assert (answer.successful, list(answer.type_sources)) == (True, [])


@pytest.mark.parametrize(
    ("name", "hash_", "text"),
    [
        ("no_such/msg/Type", "", "no_such"),
        ("nonsense", "", "nonsense"),
        (PoseStamped._TYPE, "RIHS01_00", "has the hash RIHS01_"),
    ],
)
def test_unknown_type_is_reported(name, hash_, text):
    answer = asked(type_name=name, type_hash=hash_)
    assert not answer.successful
    assert text in answer.failure_reason


def test_parameter_turns_the_service_off():
    off = Parameter("start_type_description_service", Parameter.Type.BOOL, False)
    with living() as world:
        node = world.node(parameter_overrides=[off])
        assert node.get_service_names_and_types() == []
