"""The foreign nodes in ROS's graph."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.middleware.ros.graph import ENCLAVE, Graph
from tests.middleware.ros.fake_ros import Ros

HASH, REQUEST, RESPONSE = ("RIHS01_" + letter * 64 for letter in "abc")


@pytest.fixture
def ros():
    made = Ros()
    made.own = made.new_node("_taskrpc_" + "0" * 16)
    arm = made.new_node("arm", namespace="/robot")
    arm.service_types["/open"] = ["std_srvs/srv/Trigger"]
    arm.published["/status"] = ["std_msgs/msg/String"]
    arm.published["/_taskrpc/inbox_x"] = ["std_msgs/msg/UInt8MultiArray"]
    arm.hashes = {"rr/openReply": RESPONSE, "rq/openRequest": REQUEST, "/status": HASH}
    made.arm = arm
    return made


def service_hash(type_name, request, response):
    assert (type_name, request, response) == ("std_srvs/srv/Trigger", REQUEST, RESPONSE)
    return HASH


@pytest.fixture
def graph(ros):
    return Graph(ros, ros.own, service_hash)


def test_foreign_node_has_its_services_and_topics(graph):
    assert graph.read([])
    (entry,) = graph.entries()
    assert entry.nodes == ("/robot/arm",)
    assert entry.services == (ServiceEndpoint("/open", "std_srvs/srv/Trigger", HASH, "/robot/arm"),)
    (publisher,) = entry.publishers
    assert (publisher.name, publisher.type_hash, publisher.latched) == ("/status", HASH, True)
    assert graph.servers("/open") == list(entry.services)
    assert graph.servers("/close") == []


def test_nodes_of_taskrpc_programs_are_not_foreign(graph, ros):
    other = ros.new_node("other")
    other.enclave = ENCLAVE + "1" * 16
    ros.new_node("listed")
    graph.read(["/listed"])
    assert [entry.nodes for entry in graph.entries()] == [("/robot/arm",)]


def test_same_graph_is_no_change(graph):
    assert graph.read([])
    assert not graph.read([])


def test_look_returns_the_nodes_for_some_time_after_a_change(graph, ros):
    assert graph.look() == ["_taskrpc_" + "0" * 16, "arm"]
    looks = [graph.look() for _ in range(30)]
    assert looks[0] is not None  # DDS tells later which node has what
    assert looks[-1] is None
    ros.new_node("new")
    assert "new" in graph.look()


def test_alone_until_another_node_is_there():
    ros = Ros()
    graph = Graph(ros, ros.new_node("own"), service_hash)
    graph.look()
    assert not graph.others
    ros.new_node("second")
    graph.look()
    assert graph.others


def test_hash_is_empty_if_dds_does_not_tell_it(graph, ros):
    ros.arm.hashes.clear()
    graph.read([])
    assert graph.servers("/open")[0].type_hash == ""


def test_newer_ros_tells_the_hash_of_the_service(graph, ros):
    info = SimpleNamespace(node_name="arm", node_namespace="/robot", service_type_hash=RESPONSE)
    ros.own.get_servers_info_by_service = lambda name: [info]
    graph.read([])
    assert graph.servers("/open")[0].type_hash == RESPONSE


def test_node_that_leaves_meanwhile_has_no_services(graph, ros):
    ros.own._find = lambda *_: 1 / 0
    graph.read([])
    assert graph.entries()[0].services == ()
