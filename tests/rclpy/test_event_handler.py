"""What does not match on a topic is told as ROS tells it, by the loggers of both nodes."""

import time

import pytest

import srvgen
from taskrpc import rclpy
from taskrpc.rclpy._impl.diagnostics import explain
from taskrpc.rclpy.qos import (
    DurabilityPolicy,
    QoSProfile,
    qos_profile_sensor_data,
    qos_profile_services_default,
)

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")
Int32 = srvgen.load("std_msgs/msg/Int32")
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def told(capfd, *expected):
    ends_at, said = time.monotonic() + 60, ""
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
            "[talker]: New subscription discovered on topic 'chatter', requesting incompatible"
            " QoS. No messages will be sent to it. Last incompatible policy: RELIABILITY\n",
            "[listener]: New publisher discovered on topic 'chatter', offering incompatible"
            " QoS. No messages will be received from it. Last incompatible policy: RELIABILITY\n",
        )
        listener.create_subscription(Int32, "chatter", print, qos_profile_sensor_data)
        told(
            capfd,
            "[listener]: New publisher discovered on topic 'chatter', offering incompatible"
            " type. No messages will be received from it.\n",
        )
        talker.destroy_node()
        listener.destroy_node()


LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = qos_profile_sensor_data


@pytest.mark.parametrize(
    ("server", "client", "problem"),
    [
        (None, BEST_EFFORT, "for the requests: Best effort publisher and reliable subscription"),
        (BEST_EFFORT, None, "for the responses: Best effort publisher and reliable subscription"),
        (LATCHED, None, "for the requests: Volatile publisher and transient local subscription"),
        (None, LATCHED, "for the responses: Volatile publisher and transient local subscription"),
    ],
)
@pytest.mark.parametrize("server_first", [True, False])
def test_service_and_client_with_different_qos_are_reported(
    capfd, monkeypatch, server, client, problem, server_first
):
    monkeypatch.setattr(explain, "_reported", set())
    monkeypatch.setattr(explain, "like_ros", lambda: False)
    with rclpy.init():
        node = rclpy.create_node("both")
        ends = [
            lambda: node.create_service(
                AddTwoInts, "add", add, qos_profile=server or qos_profile_services_default
            ),
            lambda: node.create_client(
                AddTwoInts, "add", qos_profile=client or qos_profile_services_default
            ),
        ]
        made = [end() for end in (ends if server_first else reversed(ends))]
        future = made[server_first].call_async(AddTwoInts.Request(a=2, b=3))
        rclpy.spin_until_future_complete(node, future, timeout_sec=5)
        assert future.result().sum == 5
    said = capfd.readouterr().err
    assert said.count("[taskrpc] ROS 2 would never connect the client and the server of /add") == 1
    assert problem in said
    assert "give both the same qos_profile" in said


@pytest.mark.parametrize("profile", [BEST_EFFORT, LATCHED, qos_profile_services_default])
def test_service_and_client_with_equal_qos_are_not_reported(capfd, monkeypatch, profile):
    monkeypatch.setattr(explain, "_reported", set())
    with rclpy.init():
        node = rclpy.create_node("both")
        server = node.create_service(AddTwoInts, "add", add, qos_profile=profile)
        node.create_client(AddTwoInts, "add", qos_profile=profile)
        node.destroy_service(server)
        node.create_client(AddTwoInts, "add", qos_profile=BEST_EFFORT)  # its server is gone
    assert "would never connect" not in capfd.readouterr().err


def add(request, response):
    response.sum = request.a + request.b
    return response
