"""The classes of ROS that belong to our classes."""

from __future__ import annotations

import pytest

import srvgen
from taskrpc.errors import TypeMismatch
from taskrpc.middleware.ros import types
from taskrpc.middleware.ros.installed import NotBuilt

Trigger = srvgen.load("std_srvs/srv/Trigger")

pytestmark = pytest.mark.usefixtures("ros")


def test_equal_class_is_found():
    assert types.ros_service(Trigger).Request is not Trigger.Request
    assert types.ros_message(srvgen.load("std_msgs/msg/String"))


def test_class_with_another_definition_gives_both_hashes():
    other = srvgen.define("std_srvs/srv/Trigger", "int32 x\n---\n")
    with pytest.raises(TypeMismatch) as caught:
        types.ros_service(other)
    assert other._HASH in str(caught.value)
    assert Trigger._HASH in str(caught.value)


def test_package_that_is_not_built_is_named():
    with pytest.raises(NotBuilt, match="example_interfaces"):
        types.ros_service(srvgen.load("example_interfaces/srv/AddTwoInts"))


def test_our_class_of_a_service_comes_from_ros_or_from_a_file():
    assert types.our_service("std_srvs/srv/Trigger") is Trigger
    assert types.our_service("example_interfaces/srv/AddTwoInts")._HASH
    with pytest.raises(NotBuilt):
        types.our_service("door_msgs/srv/Open")


def test_hash_of_a_service_follows_from_its_parts():
    parts = Trigger.Request._HASH, Trigger.Response._HASH
    assert types.service_hash("std_srvs/srv/Trigger", *parts) == Trigger._HASH
    other = types.service_hash("std_srvs/srv/Trigger", parts[1], parts[0])
    assert other == f"request {parts[1]}, response {parts[0]}"
    assert types.service_hash("door_msgs/srv/Open", *parts) == ""


@pytest.mark.parametrize("name", ["Fibonacci", "NestedMessage"])
def test_the_services_and_messages_of_an_action_are_in_its_class(name):
    type_name = f"test_msgs/action/{name}"
    impl = srvgen.load(type_name).Impl
    assert types.ros_service(impl.SendGoalService).Request
    assert types.ros_service(impl.GetResultService).Response
    assert types.ros_message(impl.FeedbackMessage)
    assert types.our_service(f"{type_name}_SendGoal")._HASH == impl.SendGoalService._HASH
    other = srvgen.define(type_name, "---\n---\nint32 x\n").Impl
    with pytest.raises(TypeMismatch, match=f"{type_name}_FeedbackMessage differs"):
        types.ros_message(other.FeedbackMessage)
    with pytest.raises(TypeMismatch, match=f"{type_name}_SendGoal differs"):
        types.ros_service(other.SendGoalService)
