"""Publishes a greeting on `chatter` once a second."""

from __future__ import annotations

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String


class Talker(Node):
    """The node `talker`."""

    def __init__(self) -> None:
        super().__init__("talker")
        self._count = 0
        self._publisher = self.create_publisher(String, "chatter", 10)
        self._timer = self.create_timer(1.0, self._greet)

    def _greet(self) -> None:
        message = String(data=f"Hello World: {self._count}")
        self._count += 1
        self.get_logger().info(f'Publishing: "{message.data}"')
        self._publisher.publish(message)


def main(args: list[str] | None = None) -> None:
    """Publish until Ctrl-C."""
    try:
        with rclpy.init(args=args):
            rclpy.spin(Talker())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
