"""The names of a node, and those that it resolves."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.exceptions import (
    InvalidTopicNameException,
)
from taskrpc.ros.packages.rclpy.node import Node
from tests.ros.packages.rclpy.living import living

pytestmark = pytest.mark.real_time


Trigger = srvgen.load("std_srvs/srv/Trigger")


def test_the_command_line_names_nodes():
    with living("--ros-args", "-r", "__node:=other", "-r", "__ns:=/foo") as world:
        assert world.node("robot").get_fully_qualified_name() == "/foo/other"
        plain = world.node("robot", use_global_arguments=False)
        assert plain.get_fully_qualified_name() == "/robot"
        own = world.node("robot", cli_args=["--ros-args", "-r", "__node:=mine"])
        assert own.get_fully_qualified_name() == "/foo/mine"


def test_names_are_resolved_and_remapped(world):
    node = world.node(namespace="ns", cli_args=["--ros-args", "-r", "x:=y"])
    assert node.resolve_topic_name("x") == node.resolve_service_name("x") == "/ns/y"
    assert node.resolve_topic_name("x", only_expand=True) == "/ns/x"
    assert node.resolve_service_name("~/x") == "/ns/robot/x"
    with pytest.raises(InvalidTopicNameException):
        node.resolve_topic_name("x?")


def test_a_node_whose_init_comes_too_late_says_so():
    class Robot(Node):
        def __init__(self):
            self.create_service(Trigger, "go", print)
            super().__init__("robot")

    with pytest.raises(AttributeError, match=r"'Robot' object has .*; call super\(\).__init__"):
        Robot()
