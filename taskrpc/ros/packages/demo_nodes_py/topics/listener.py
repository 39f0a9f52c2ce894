"""Prints what it receives on `chatter`."""

from __future__ import annotations

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String


class Listener(Node):
    """The node `listener`."""

    def __init__(self) -> None:
        super().__init__("listener")
        self._subscription = self.create_subscription(String, "chatter", self._print, 10)

    def _print(self, message: String) -> None:
        self.get_logger().info(f"I heard: [{message.data}]")


def main(args: list[str] | None = None) -> None:
    """Listen until Ctrl-C."""
    try:
        with rclpy.init(args=args):
            rclpy.spin(Listener())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
