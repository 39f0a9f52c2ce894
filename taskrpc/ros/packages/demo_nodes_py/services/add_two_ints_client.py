"""Calls `add_two_ints` once, with 2 and 3, and prints the sum."""

from __future__ import annotations

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.executors import ExternalShutdownException


def main(args: list[str] | None = None) -> None:
    """Wait for the service, call it, and end."""
    try:
        with rclpy.init(args=args):
            node = rclpy.create_node("add_two_ints_client")
            client = node.create_client(AddTwoInts, "add_two_ints")
            while not client.wait_for_service(timeout_sec=1.0):
                print("service not available, waiting again...")
            future = client.call_async(AddTwoInts.Request(a=2, b=3))
            rclpy.spin_until_future_complete(node, future)
            if (response := future.result()) is not None:
                node.get_logger().info(f"Result of add_two_ints: {response.sum}")
            else:
                node.get_logger().error(f"Exception while calling service: {future.exception()!r}")
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
