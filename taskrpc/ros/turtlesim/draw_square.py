"""`taskrpc run turtlesim draw_square`: resets turtlesim and lets its turtle draw squares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rclpy
from geometry_msgs.msg import Twist
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_srvs.srv import Empty

from taskrpc.ros.turtlesim.square import SquareDriver, is_moving
from taskrpc.ros.turtlesim.types import Pose
from taskrpc.ros.turtlesim.world import STEP


class DrawSquare(Node):
    """The node `draw_square`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("draw_square", **options)
        self._driver = SquareDriver()
        self._pose: Pose | None = None
        self._velocities = self.create_publisher(Twist, "turtle1/cmd_vel", 1)
        self._poses = self.create_subscription(Pose, "turtle1/pose", self._keep, 1)
        self._reset = self.create_client(Empty, "reset")
        self._reset.wait_for_service()
        self._reset.call_async(Empty.Request()).add_done_callback(self._begin)

    def _keep(self, pose: Pose) -> None:
        self._pose = pose

    def _begin(self, _: Any) -> None:
        self._pose = None  # it was measured before the reset
        self.create_timer(STEP, self._drive)

    def _drive(self) -> None:
        if (pose := self._pose) is None:
            return
        moves = is_moving(pose.linear_velocity, pose.angular_velocity)
        command = self._driver.command((pose.x, pose.y, pose.theta), moves)
        for line in command.log:
            self.get_logger().info(line)
        twist = Twist()
        twist.linear.x, twist.angular.z = command.linear, command.angular
        self._velocities.publish(twist)


def main(args: Sequence[str] | None = None) -> int:
    """Draw until Ctrl-C."""
    try:
        with rclpy.init(args=args):
            rclpy.spin(DrawSquare())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0
