"""Starts the talker and the listener."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """The two programs."""
    programs = [
        Node(package="demo_nodes_cpp", executable=name, output="screen")
        for name in ("talker", "listener")
    ]
    return LaunchDescription(programs)
