"""Starts the talker and the listener; the file's name until ROS 2 Humble."""

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution, ThisLaunchFileDir


def generate_launch_description() -> LaunchDescription:
    """The two programs."""
    path = PathJoinSubstitution([ThisLaunchFileDir(), "talker_listener_launch.py"])
    return LaunchDescription([IncludeLaunchDescription(path)])
