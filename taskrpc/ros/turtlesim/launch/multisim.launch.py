"""Starts two simulators, each in a namespace of its own."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """The two simulators."""
    program = {"package": "turtlesim", "executable": "turtlesim_node", "output": "screen"}
    return LaunchDescription([Node(namespace=f"turtlesim{number}", **program) for number in (1, 2)])
