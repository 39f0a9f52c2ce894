"""Simulated time: the parameter use_sim_time and the messages on /clock."""

from __future__ import annotations

import pytest

import srvgen
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy.clock import Clock, ClockType, ROSClock
from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.parameter import Parameter
from taskrpc.ros.packages.rclpy.time import Time
from taskrpc.ros.packages.rclpy.time_source import CLOCK_TOPIC, TimeSource

ClockMessage = srvgen.load("rosgraph_msgs/msg/Clock")

pytestmark = pytest.mark.real_time


@pytest.fixture
def node():
    rclpy.init(args=[])
    yield rclpy.create_node("timed")
    rclpy.try_shutdown()


def set_sim_time(node, value):
    return node.set_parameters([Parameter("use_sim_time", value=value)])[0]


def publish(node, *seconds):
    """Publish on /clock, and spin until the node's own clock shows each time."""
    publisher = node.create_publisher(ClockMessage, CLOCK_TOPIC, 1)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    for second in seconds:
        message = ClockMessage()
        message.clock.sec = second
        publisher.publish(message)
        for _ in range(100):
            if node.get_clock().now() == Time(seconds=second, clock_type=ClockType.ROS_TIME):
                break
            executor.spin_once(0.05)
        else:
            pytest.fail(f"{second} never came")


def test_without_use_sim_time_a_node_shows_the_systems_time(node):
    assert not node.get_clock().ros_time_is_active
    assert abs(node.get_clock().now().nanoseconds - Clock().now().nanoseconds) < 10**9


def test_with_use_sim_time_a_node_shows_simulated_time(node):
    assert set_sim_time(node, True).successful
    clock = node.get_clock()
    assert clock.now() == Time(clock_type=ClockType.ROS_TIME)
    publish(node, 3, 5)
    assert clock.now() == Time(seconds=5, clock_type=ClockType.ROS_TIME)
    assert set_sim_time(node, False).successful
    assert clock.now() > Time(seconds=10**9, clock_type=ClockType.ROS_TIME)


def test_use_sim_time_from_the_command_line_applies_from_the_start():
    with rclpy.init(args=["--ros-args", "-p", "use_sim_time:=true"]):
        node = rclpy.create_node("simulated")
        assert node.get_clock().now() == Time(clock_type=ClockType.ROS_TIME)


def test_a_timer_follows_simulated_time(node):
    set_sim_time(node, True)
    calls = []
    node.create_timer(10, lambda: calls.append(node.get_clock().now().seconds_nanoseconds()[0]))
    publish(node, 9)
    rclpy.spin_once(node, timeout_sec=0.01)
    assert calls == []
    publish(node, 11)
    rclpy.spin_once(node, timeout_sec=1)
    assert calls == [11]


def test_use_sim_time_must_be_true_or_false(node):
    result = set_sim_time(node, "yes")
    assert not result.successful
    assert not node.get_clock().ros_time_is_active


def test_attached_clock_shows_the_last_time_at_once(node):
    set_sim_time(node, True)
    publish(node, 4)
    late = ROSClock()
    node._time_source.attach_clock(late)
    assert late.now() == Time(seconds=4, clock_type=ClockType.ROS_TIME)
    with pytest.raises(ValueError, match="Only clocks with type ROS_TIME"):
        node._time_source.attach_clock(Clock())


def test_the_source_decides_whether_a_clock_is_simulated(node):
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    node._time_source.attach_clock(clock)
    assert not clock.ros_time_is_active


def test_a_source_follows_one_node(node):
    source = TimeSource(node=node)
    set_sim_time(node, True)
    assert source.ros_time_is_active
    assert source._clock_sub is not None
    source.detach_node()
    assert source._clock_sub is None
    other = rclpy.create_node("other")
    source.attach_node(other)
    assert source._get_node() is other
    with pytest.raises(TypeError, match=r"rclpy\.node\.Node"):
        source.attach_node("no node")
