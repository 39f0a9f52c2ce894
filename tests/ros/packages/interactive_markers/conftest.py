"""A node without a middleware, and a server of interactive markers on it."""

import importlib
from types import SimpleNamespace

import pytest


class Node:
    """Keeps what a server of markers creates and publishes; its clock stands until it is set."""

    def __init__(self):
        self.seconds = 0.0
        self.created, self.destroyed, self.published = {}, [], []

    def create_service(self, kind, name, callback):
        self.created[name] = callback
        return name

    def create_subscription(self, kind, name, callback, depth):
        self.created[name] = callback
        return name

    def create_publisher(self, kind, name, depth):
        self.created[name] = depth
        return SimpleNamespace(publish=self.published.append)

    def destroy_service(self, one):
        self.destroyed.append(one)

    destroy_publisher = destroy_subscription = destroy_service

    def get_clock(self):
        time = importlib.import_module("rclpy.time").Time
        return SimpleNamespace(now=lambda: time(nanoseconds=round(self.seconds * 10**9)))

    def get_logger(self):
        return SimpleNamespace(debug=lambda text: None)


@pytest.fixture
def node():
    return Node()


@pytest.fixture
def server(ros_names, node):
    return importlib.import_module("interactive_markers").InteractiveMarkerServer(node, "sim")


@pytest.fixture
def messages(ros_names):
    return importlib.import_module("visualization_msgs.msg")


@pytest.fixture
def pose(ros_names):
    module = importlib.import_module("geometry_msgs.msg")
    return lambda x: module.Pose(position=module.Point(x=x))
