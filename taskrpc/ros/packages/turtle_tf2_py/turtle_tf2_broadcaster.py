"""Sends the pose of a turtle of turtlesim as a transform: `taskrpc run turtle_tf2_py`."""

from __future__ import annotations

from typing import Any

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_py.geometry import quaternion_of_angles
from tf2_ros import TransformBroadcaster
from turtlesim.msg import Pose

from taskrpc.ros.optional import needed


def quaternion_from_euler(ai: float, aj: float, ak: float) -> Any:
    """The quaternion x, y, z, w of roll, pitch and yaw in radians, as a NumPy array."""
    return needed("numpy", "turtle_tf2_py").array(quaternion_of_angles(ai, aj, ak))


def frame_of(turtle: str, pose: Any) -> Any:
    """The transform from `world` to a turtle with this pose, without the time."""
    transform = TransformStamped(child_frame_id=turtle)
    transform.header.frame_id = "world"
    moved, turned = transform.transform.translation, transform.transform.rotation
    moved.x, moved.y = pose.x, pose.y
    turned.x, turned.y, turned.z, turned.w = quaternion_of_angles(0.0, 0.0, pose.theta)
    return transform


class FramePublisher(Node):
    """The node `turtle_tf2_frame_publisher`; its parameter `turtlename` names the turtle."""

    def __init__(self) -> None:
        super().__init__("turtle_tf2_frame_publisher")
        self.turtlename = self.declare_parameter("turtlename", "turtle").value
        self.tf_broadcaster = TransformBroadcaster(self)
        self.subscription = self.create_subscription(
            Pose, f"/{self.turtlename}/pose", self.handle_turtle_pose, 1
        )

    def handle_turtle_pose(self, msg: Any) -> None:
        """Send the frame of the turtle."""
        transform = frame_of(self.turtlename, msg)
        transform.header.stamp = self.get_clock().now().to_msg()
        self.tf_broadcaster.sendTransform(transform)


def main(args: list[str] | None = None) -> None:
    """Send frames until Ctrl-C."""
    try:
        with rclpy.init(args=args):
            rclpy.spin(FramePublisher())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
