"""Offers `add_two_ints`."""

from __future__ import annotations

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class AddTwoIntsServer(Node):
    """The node `add_two_ints_server`."""

    def __init__(self) -> None:
        super().__init__("add_two_ints_server")
        self._service = self.create_service(AddTwoInts, "add_two_ints", self._add)

    def _add(
        self, request: AddTwoInts.Request, response: AddTwoInts.Response
    ) -> AddTwoInts.Response:
        response.sum = request.a + request.b
        self.get_logger().info(f"Incoming request\na: {request.a} b: {request.b}")
        return response


def main(args: list[str] | None = None) -> None:
    """Serve until Ctrl-C."""
    try:
        with rclpy.init(args=args):
            rclpy.spin(AddTwoIntsServer())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
