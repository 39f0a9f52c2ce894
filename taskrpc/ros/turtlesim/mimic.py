"""`taskrpc run turtlesim mimic`: lets one turtle move as another one does.

Remap `input/pose` and `output/cmd_vel` to the topics of the two turtles.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rclpy
from geometry_msgs.msg import Twist
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from taskrpc.ros.turtlesim.types import Pose


class Mimic(Node):
    """The node `turtle_mimic`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("turtle_mimic", **options)
        self._velocities = self.create_publisher(Twist, "output/cmd_vel", 1)
        self._poses = self.create_subscription(Pose, "input/pose", self._follow, 1)

    def _follow(self, pose: Pose) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = pose.linear_velocity, pose.angular_velocity
        self._velocities.publish(twist)


def main(args: Sequence[str] | None = None) -> int:
    """Imitate until Ctrl-C."""
    try:
        with rclpy.init(args=args):
            rclpy.spin(Mimic())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0
