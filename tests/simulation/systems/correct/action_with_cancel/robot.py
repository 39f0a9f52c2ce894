import time

import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.server = ActionServer(
            self,
            Fibonacci,
            "drive",
            self.drive,
            callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def drive(self, goal_handle):
        order = goal_handle.request.order
        for _ in range(order):
            if goal_handle.is_cancel_requested:
                goal_handle.canceled()
                self.get_logger().info(f"stops on the way to {order}")
                return Fibonacci.Result()
            time.sleep(0.25)
        goal_handle.succeed()
        self.get_logger().info(f"arrives at {order}")
        return Fibonacci.Result()


def main():
    rclpy.init()
    executor = MultiThreadedExecutor()
    executor.add_node(Robot())
    executor.spin()


if __name__ == "__main__":
    main()
