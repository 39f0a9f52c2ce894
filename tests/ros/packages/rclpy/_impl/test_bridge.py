"""Sending leaves a program's message as the program set it, as in ROS, where C has its own copy."""

import copy

import pytest

import srvgen
from taskrpc.ros.packages.rclpy._impl.bridge import detached
from taskrpc.ros.packages.rclpy.serialization import serialize_message
from tests.ros.packages.rclpy.living import living

Float32 = srvgen.load("std_msgs/msg/Float32")
Twist = srvgen.load("geometry_msgs/msg/Twist")
PoseArray = srvgen.load("geometry_msgs/msg/PoseArray")
Pose = srvgen.load("geometry_msgs/msg/Pose")
Spawn = srvgen.load("turtlesim/srv/Spawn")
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


@pytest.mark.real_time
def test_a_published_message_and_the_received_one_are_different_objects():
    came = []
    with living() as world:
        node = world.node()
        node.create_subscription(Float32, "heat", came.append, 10)
        message = Float32(data=0.1)
        node.create_publisher(Float32, "heat", 10).publish(message)
        message.data += 1
        world.spin_until(lambda: came)
    assert message.data == 1.1
    assert came[0].data == pytest.approx(0.1)
    assert came[0].data != 0.1, "it went as a float32"


@pytest.mark.real_time
def test_a_request_and_a_response_stay_as_they_were_set():
    request, kept = Spawn.Request(x=2, y=0.1), Spawn.Response(name="turtle2")

    def spawn(request, response):
        assert (request.x, type(request.x)) == (2.0, float)
        return kept

    with living() as world:
        node = world.node()
        node.create_service(Spawn, "spawn", spawn)
        client = node.create_client(Spawn, "spawn")
        response = world.answer(client.call_async(request))
    assert str(request) == "turtlesim.srv.Spawn_Request(x=2, y=0.1, theta=0.0, name='')"
    assert response == kept
    assert response is not kept


@pytest.mark.parametrize(
    "message",
    [
        AddTwoInts.Request(a=True, b=2),
        Twist(linear=srvgen.load("geometry_msgs/msg/Vector3")(x=1)),
        PoseArray(poses=[Pose(), Pose()]),
        PoseArray(poses=(Pose(),)),
    ],
)
def test_a_check_of_the_copy_changes_nothing_else(message):
    if isinstance(message, PoseArray):
        message.poses[0].position.x = 1
    before, sent = repr(message), detached(message)
    assert sent == message
    serialize_message(message)
    sent._check()
    assert repr(message) == before
    assert repr(sent) != before


def test_what_is_no_message_is_left_to_the_check():
    wrong = Twist(linear=5)
    sent = detached(wrong)
    assert sent.linear == 5
    assert copy.copy(wrong) == sent
    with pytest.raises(ValueError, match=r"^linear: expected geometry_msgs/msg/Vector3"):
        sent._check()


def test_only_messages_can_be_serialized():
    with pytest.raises(AttributeError, match="'str' has no attribute '_TYPE_SUPPORT'"):
        serialize_message("a message")
