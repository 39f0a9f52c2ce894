"""Nodes: names, creation and destruction of their entities, as in rclpy."""

import contextlib
import threading

import pytest

import srvgen
from taskrpc.ros.packages.rclpy import executors
from taskrpc.ros.packages.rclpy.clock_type import ClockType
from taskrpc.ros.packages.rclpy.exceptions import (
    InvalidHandle,
    InvalidNamespaceException,
    InvalidNodeNameException,
    NotInitializedException,
    RCLInvalidROSArgsError,
    UnknownROSArgsError,
)
from taskrpc.ros.packages.rclpy.node import Node
from tests.ros.packages.rclpy.living import context_of

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")
Trigger = srvgen.load("std_srvs/srv/Trigger")


@pytest.mark.parametrize(
    ("namespace", "whole"), [(None, "/"), ("", "/"), ("ns", "/ns"), ("/my/ns", "/my/ns")]
)
def test_a_namespace_may_be_empty_or_relative(world, namespace, whole):
    node = world.node("robot", namespace=namespace)
    assert (node.get_name(), node.get_namespace()) == ("robot", whole)
    assert node.get_fully_qualified_name() == f"{whole.rstrip('/')}/robot"
    assert node.get_clock().clock_type is ClockType.ROS_TIME
    assert node.handle.valid
    with pytest.raises(AttributeError):
        node.handle = "garbage"


@pytest.mark.parametrize(
    ("name", "namespace", "kind"),
    [
        ("bad?", None, InvalidNodeNameException),
        ("fine", "bad?", InvalidNamespaceException),
        ("fine", "/bad?", InvalidNamespaceException),
    ],
)
def test_bad_names_are_refused_with_the_messages_of_ros(world, name, namespace, kind):
    with pytest.raises(kind, match="must not contain characters"):
        world.node(name, namespace=namespace)


def test_a_node_needs_a_context_that_is_up():
    with context_of() as context:
        context.shutdown()
        with pytest.raises(NotInitializedException, match="msg:cannot create node"):
            Node("robot", context=context)


def test_arguments_of_a_node_that_cannot_be_read_are_refused(world):
    with pytest.raises(RCLInvalidROSArgsError, match="not-a-remap"):
        world.node(cli_args=["--ros-args", "-r", "not-a-remap"])
    with pytest.raises(UnknownROSArgsError, match=r"\['--my-flag'\]"):
        world.node(cli_args=["--ros-args", "--my-flag"])


def test_destroyed_node_has_no_entities_and_may_be_destroyed_again(world):
    node = world.node()
    node.create_timer(10, lambda: None)
    rate = node.create_rate(10)
    node.create_publisher(String, "chatter", 10)
    node.destroy_node()
    node.destroy_node()
    assert not [*node.timers, *node.publishers, *node.services, *node.subscriptions]
    with pytest.raises(InvalidHandle):
        node.get_name()
    with pytest.raises(InvalidHandle), node.handle:
        pass
    with pytest.raises(RuntimeError, match="destroyed"):
        rate.sleep()


def test_end_of_a_with_block_destroys_the_node(world):
    with world.node() as node:
        assert node.handle.valid
    assert not node.handle.valid


def test_the_shutdown_destroys_all_nodes():
    with context_of() as context:
        node = Node("robot", context=context)
        context.shutdown()
        assert not node.handle.valid


def test_a_node_may_be_destroyed_while_it_is_spun(world):
    node = world.node()
    spun = threading.Event()
    node.create_timer(0.0, spun.set)

    def spin():
        with contextlib.suppress(executors.ExternalShutdownException):
            world.executor.spin()

    thread = threading.Thread(target=spin)
    thread.start()
    assert spun.wait(60)
    node.destroy_node()
    world.context.shutdown()
    thread.join(5)
    assert not thread.is_alive()


class Executor:
    def __init__(self):
        self.told = []

    def add_node(self, node):
        self.told.append("add")
        return True

    def remove_node(self, node):
        self.told.append("remove")

    def wake(self):
        """Do nothing: no thread sleeps."""


def test_a_node_moves_from_one_executor_to_another():
    with context_of() as context:
        node = Node("robot", context=context)
        assert node.executor is None
        old, new = Executor(), Executor()
        node.executor = old
        assert node.executor is old
        node.executor = new
        assert node.executor is new
        assert (old.told, new.told) == (["add", "remove"], ["add"])
        node.executor = None
        assert node.executor is None


def test_two_contexts_of_other_domains_do_not_see_each_other():
    with context_of() as here, context_of() as there:
        here._domain_id, there._domain_id = 41, 42
        near, far = Node("near", context=here), Node("far", context=there)
        assert near.get_node_names() == ["near"]
        assert far.get_node_names() == ["far"]


PLAIN = (
    "_added _as_node _bridge _by_node _clients _count _declare _destroyed _executor _forget _group"
    " _guards _handle _join _keep _looked_for _name _namespace _publishers _rates _remapping"
    " _resolve _rosout _services _subscriptions _timers _topic_qos _waitables"
).split()


def test_subclass_may_define_attributes_that_rclpys_node_does_not_use(world):
    class Robot(Node):
        def __init__(self, context):
            super().__init__("robot", context=context)
            for name in PLAIN:
                setattr(self, name, name)
            self.pressed = []
            self.create_service(Trigger, "press", self.press)

        def press(self, request, response):
            self.pressed.append(request)
            response.success = self.count_publishers("talk") == 1
            return response

    node = Robot(world.context)
    node.create_publisher(String, "talk", 10)
    node.create_subscription(String, "talk", print, 10)
    node.declare_parameter("speed", 1.0)
    node.create_timer(0.01, lambda: None)
    world.executor.add_node(node)
    client = node.create_client(Trigger, "press")
    assert world.answer(client.call_async(Trigger.Request())).success
    assert [getattr(node, name) for name in PLAIN] == PLAIN
    node.destroy_node()


def test_an_error_about_arguments_names_the_method_as_ros_does():
    with pytest.raises(TypeError, match=r"^Node\.create_publisher\(\) missing 1 required"):
        Node.create_publisher(None, None, "topic")


def test_misspelt_method_raises_attribute_error(world):
    with pytest.raises(
        AttributeError, match=r"^'Node' object has no attribute 'get_loger'$"
    ) as told:
        _ = world.node().get_loger
    assert told.value.name == "get_loger"
