"""`tf2_ros` by its name, and messages for it."""

import importlib
from types import SimpleNamespace

import pytest


@pytest.fixture
def ros(ros_names):
    """The modules and classes that programs with transforms import."""
    load = importlib.import_module
    return SimpleNamespace(
        tf2_ros=load("tf2_ros"),
        Time=load("rclpy.time").Time,
        Duration=load("rclpy.duration").Duration,
        qos=load("rclpy.qos"),
        geometry=load("geometry_msgs.msg"),
        TFMessage=load("tf2_msgs.msg").TFMessage,
        module=load,
    )


@pytest.fixture
def link(ros):
    """Makes a TransformStamped."""

    def make(parent, child, sec=1, x=0.0, y=0.0, z=0.0):
        message = ros.geometry.TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        message.header.stamp.sec = sec
        moved = message.transform.translation
        moved.x, moved.y, moved.z = x, y, z
        return message

    return make


class FakeNode:
    """Notes the subscriptions, publishers and services that are created."""

    def __init__(self, clock=None):
        self.made = []
        self.destroyed = []
        self._clock = clock

    def create_subscription(self, kind, topic, callback, qos, *, callback_group=None):
        self.made.append(SimpleNamespace(kind=kind, topic=topic, callback=callback, qos=qos))
        self.made[-1].group = callback_group
        return self.made[-1]

    def create_publisher(self, kind, topic, qos):
        sent = []
        self.made.append(SimpleNamespace(kind=kind, topic=topic, qos=qos, sent=sent))
        self.made[-1].publish = sent.append
        return self.made[-1]

    def create_service(self, kind, name, callback):
        self.made.append(SimpleNamespace(kind=kind, name=name, callback=callback))
        return self.made[-1]

    def destroy_subscription(self, subscription):
        self.destroyed.append(subscription)

    def get_clock(self):
        return self._clock


@pytest.fixture
def node(ros):
    return FakeNode(ros.module("rclpy.clock").Clock())
