"""Publishers, subscriptions, servers and clients of all processes, with their profiles."""

import pytest

import srvgen
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy._impl.diagnostics import explain
from taskrpc.ros.packages.rclpy.duration import Duration
from taskrpc.ros.packages.rclpy.endpoint_info import EndpointTypeEnum
from taskrpc.ros.packages.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
    qos_profile_services_default,
)
from tests.ros.packages.rclpy.living import AddTwoInts, add

pytestmark = pytest.mark.real_time


String = srvgen.load("std_msgs/msg/String")
Trigger = srvgen.load("std_srvs/srv/Trigger")


@pytest.fixture
def node(world):
    return world.node("robot", namespace="/ns")


def test_an_endpoint_tells_its_node_its_type_and_its_whole_profile(node):
    profile = QoSProfile(
        history=HistoryPolicy.KEEP_ALL,
        deadline=Duration(seconds=1),
        lifespan=Duration(seconds=20),
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    )
    node.create_publisher(String, "talk", profile)
    node.create_subscription(String, "talk", print, 7)
    (info,) = node.get_publishers_info_by_topic("/ns/talk")
    assert (info.node_name, info.node_namespace) == ("robot", "/ns")
    assert (info.topic_type, str(info.topic_type_hash)) == (String._TYPE, String._HASH)
    assert info.endpoint_type is EndpointTypeEnum.PUBLISHER
    assert (info.qos_profile, len(info.endpoint_gid)) == (profile, 16)
    assert "Reliability: BEST_EFFORT" in str(info)
    (read,) = node.get_subscriptions_info_by_topic("talk")
    assert read.qos_profile.depth == 7
    assert node.get_publishers_info_by_topic("rt/ns/talk", no_mangle=True) == [info]


def test_servers_and_clients_are_told_one_by_one(node):
    node.create_service(Trigger, "go", lambda request, response: response)
    node.create_client(Trigger, "go")
    (server,) = node.get_servers_info_by_service("go")
    (client,) = node.get_clients_info_by_service("/ns/go")
    assert server.endpoint_type is EndpointTypeEnum.SERVER
    assert client.endpoint_type is EndpointTypeEnum.CLIENT
    assert server.service_type == client.service_type == "std_srvs/srv/Trigger"
    assert "Node name: robot" in str(server)


def test_the_log_is_published_with_the_profile_that_the_program_gives(world):
    best_effort = QoSProfile(
        depth=3,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        lifespan=Duration(seconds=20),
    )
    silent = world.node("silent", enable_rosout=False)
    assert silent.get_publishers_info_by_topic("/rosout") == []
    world.node("loud", rosout_qos_profile=best_effort)
    (info,) = silent.get_publishers_info_by_topic("/rosout")
    assert (info.node_name, info.qos_profile) == ("loud", best_effort)


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
