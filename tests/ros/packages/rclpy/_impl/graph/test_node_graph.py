"""A node sees all nodes, topics and services of the network."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.exceptions import InvalidHandle, NodeNameNonExistentError
from tests.ros.packages.rclpy.living import living

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")
Trigger = srvgen.load("std_srvs/srv/Trigger")


@pytest.fixture
def node(world):
    return world.node("robot", namespace="/ns")


def test_nodes_are_seen_by_name_and_namespace(world, node):
    world.node("other")
    assert set(node.get_node_names()) == {"robot", "other"}
    assert set(node.get_node_names_and_namespaces()) == {("robot", "/ns"), ("other", "/")}
    assert ("robot", "/ns", "/") in node.get_node_names_and_namespaces_with_enclaves()
    assert "/ns/robot" in node.get_fully_qualified_node_names()
    assert node.wait_for_node("/other", 1.0)
    assert not node.wait_for_node("nobody", 0.05)


def test_topics_are_seen_with_their_types(node):
    node.create_publisher(String, "talk", 10)
    assert ("/ns/talk", ["std_msgs/msg/String"]) in node.get_topic_names_and_types()
    assert ("rt/ns/talk", ["std_msgs/msg/String"]) in node.get_topic_names_and_types(True)
    published = node.get_publisher_names_and_types_by_node("robot", "/ns")
    assert ("/ns/talk", ["std_msgs/msg/String"]) in published
    assert node.get_subscriber_names_and_types_by_node("robot", "/ns") == []


def test_services_are_seen_with_their_types(node):
    node.create_service(Trigger, "go", lambda request, response: response)
    node.create_client(Trigger, "/far/go")
    assert ("/ns/go", ["std_srvs/srv/Trigger"]) in node.get_service_names_and_types()
    offered = node.get_service_names_and_types_by_node("robot", "/ns")
    assert ("/ns/go", ["std_srvs/srv/Trigger"]) in offered
    called = node.get_client_names_and_types_by_node("robot", "/ns")
    assert called == [("/far/go", ["std_srvs/srv/Trigger"])]


def test_a_question_about_an_unknown_node_is_refused(node):
    with pytest.raises(NodeNameNonExistentError, match="nonexistent node: /ns, nobody"):
        node.get_service_names_and_types_by_node("nobody", "/ns")


def test_a_destroyed_node_sees_nothing(node):
    node.destroy_node()
    for question in (node.get_node_names, node.get_topic_names_and_types):
        with pytest.raises(InvalidHandle):
            question()


def test_every_node_has_what_rosss_command_line_shows():
    with living() as world:
        node = world.node("robot", start_parameter_services=True)
        services = [name for name, _ in node.get_service_names_and_types()]
        assert services == [
            f"/robot/{name}"
            for name in (
                "describe_parameters",
                "get_parameter_types",
                "get_parameters",
                "get_type_description",
                "list_parameters",
                "set_parameters",
                "set_parameters_atomically",
            )
        ]


def test_endpoints_are_counted_by_relative_and_absolute_names(node):
    assert node.count_publishers("talk") == node.count_subscribers("/ns/talk") == 0
    publisher = node.create_publisher(String, "talk", 10)
    for count in (1, 2):
        node.create_subscription(String, "talk", print, 10)
        assert node.count_subscribers("talk") == node.count_subscribers("/ns/talk") == count
        assert publisher.get_subscription_count() == count
    assert node.count_publishers("/ns/talk") == 1
    node.create_client(Trigger, "go")
    assert (node.count_clients("go"), node.count_services("go")) == (1, 0)


def test_every_server_of_a_service_is_counted(world, node):
    twin, caller = world.node("twin", namespace="/ns"), world.node("caller")

    def counts():
        servers = caller.get_servers_info_by_service("/ns/go")
        names = sorted(one.node_name for one in servers)
        return caller.count_services("/ns/go"), names

    servers = [each.create_service(Trigger, "go", print) for each in (node, node, twin)]
    assert counts() == (3, ["robot", "robot", "twin"])
    node.destroy_service(servers[0])
    assert counts() == (2, ["robot", "twin"])
    node.destroy_service(servers[1])
    assert counts() == (1, ["twin"])
    again = node.create_service(Trigger, "go", print)
    assert counts() == (2, ["robot", "twin"])
    node.destroy_service(again)
    twin.destroy_service(servers[2])
    assert counts() == (0, [])


def test_a_bad_name_is_refused_with_ross_words(node):
    for ask in (node.count_publishers, node.count_services, node.get_publishers_info_by_topic):
        with pytest.raises(TypeError, match="bad argument type"):
            ask(1)
        with pytest.raises(ValueError, match="is invalid"):
            ask("42")
