"""Starts the talker and the listener."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """The two programs."""
    program = {"package": "demo_nodes_cpp", "output": "screen"}
    return LaunchDescription([Node(executable=name, **program) for name in ("talker", "listener")])
