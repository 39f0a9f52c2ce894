"""Type hashes, type checks, and names of what is not there yet."""

import pytest

import srvgen
from taskrpc.rclpy import action, type_support
from taskrpc.rclpy.action import ActionClient, ActionServer
from taskrpc.rclpy.exceptions import NoTypeSupportImportedException
from taskrpc.rclpy.topic_endpoint_info import TopicEndpointInfo, TopicEndpointTypeEnum
from taskrpc.rclpy.type_hash import TypeHash, type_hash_of

String = srvgen.load("std_msgs/msg/String")
Trigger = srvgen.load("std_srvs/srv/Trigger")


def test_a_type_hash_is_written_as_ros_writes_it():
    assert str(type_hash_of(String._HASH)) == String._HASH
    assert str(TypeHash()) == "INVALID"
    assert TypeHash(version=1, value=bytes(32)) == TypeHash(1, bytes(32))
    assert TypeHash(version=5) != TypeHash()


class Unsupported(type):
    _TYPE_SUPPORT = None


class Mistaken(metaclass=Unsupported):
    """Looks like an interface of ROS, and is none."""


def test_only_interfaces_are_taken_for_types():
    type_support.check_is_valid_msg_type(String)
    type_support.check_is_valid_srv_type(Trigger)
    with pytest.raises(AttributeError):
        type_support.check_for_type_support(object())
    with pytest.raises(NoTypeSupportImportedException):
        type_support.check_for_type_support(Mistaken)
    with pytest.raises(RuntimeError):
        type_support.check_is_valid_msg_type(Trigger)
    with pytest.raises(RuntimeError):
        type_support.check_is_valid_srv_type(String)


def test_a_program_with_actions_is_warned_once_and_runs_until_it_uses_one(capsys, fake, context):
    for _ in range(2):
        client = ActionClient(fake, None, "turn")
        server = ActionServer(fake, None, "turn", print, goal_callback=print)
    error = capsys.readouterr().err
    assert [line.split(" does nothing here: ")[0] for line in error.splitlines()] == [
        "[taskrpc] ActionClient('turn')",
        "[taskrpc] ActionServer('turn')",
    ]
    server.register_execute_callback(print)
    assert (client.server_is_ready(), client.wait_for_server(timeout_sec=0.01)) == (False, False)
    for use in (client.wait_for_server, lambda: client.send_goal_async(None)):
        with pytest.raises(NotImplementedError, match="no actions yet; use a service"):
            use()
    client.destroy()
    server.destroy()


def test_modules_of_actions_have_the_names_that_programs_import_from_them():
    status = srvgen.load("action_msgs/msg/GoalStatus")
    assert action.client.GoalStatus is action.server.GoalStatus is status


def test_an_entry_takes_plain_data_for_its_fields():
    info = TopicEndpointInfo(
        node_name="a", endpoint_type=1, topic_type_hash={"version": 1, "value": bytes(32)}
    )
    assert info.endpoint_type is TopicEndpointTypeEnum.PUBLISHER
    assert str(info.topic_type_hash) == "RIHS01_" + "00" * 32
    assert TopicEndpointInfo() == TopicEndpointInfo()
    assert "Endpoint type: INVALID\nGID: \nQoS profile:" in str(TopicEndpointInfo())
    with pytest.raises(AssertionError):
        info.node_name = 7
