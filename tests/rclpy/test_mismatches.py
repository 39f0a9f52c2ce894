"""What does not match on a topic is told as ROS tells it, by the loggers of both nodes."""

import time

import pytest

import srvgen
from taskrpc import rclpy
from taskrpc.rclpy.qos import qos_profile_sensor_data

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")
Int32 = srvgen.load("std_msgs/msg/Int32")


def told(capfd, *expected):
    ends_at, said = time.monotonic() + 5, ""
    while not all(text in said for text in expected):
        assert time.monotonic() < ends_at, said
        time.sleep(0.01)
        captured = capfd.readouterr()
        said += captured.out + captured.err


def test_incompatible_qos_and_types_are_warned_of_by_both_nodes(capfd):
    with rclpy.init():
        talker, listener = rclpy.create_node("talker"), rclpy.create_node("listener")
        talker.create_publisher(String, "chatter", qos_profile_sensor_data)
        listener.create_subscription(String, "chatter", print, 10)
        told(
            capfd,
            "[talker]: New subscription discovered on topic '/chatter', requesting incompatible"
            " QoS. No messages will be sent to it. Last incompatible policy: RELIABILITY\n",
            "[listener]: New publisher discovered on topic '/chatter', offering incompatible"
            " QoS. No messages will be received from it. Last incompatible policy: RELIABILITY\n",
        )
        listener.create_subscription(Int32, "chatter", print, qos_profile_sensor_data)
        told(
            capfd,
            "[listener]: New publisher discovered on topic '/chatter', offering incompatible"
            " type. No messages will be received from it.\n",
        )
        talker.destroy_node()
        listener.destroy_node()
