"""Lab 1: a service that adds two integers."""

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddServer(Node):
    def __init__(self):
        super().__init__("add_server")
        # 1. Create the service "@SERVICE@" of the type AddTwoInts.
        #    Its callback is self.add.

    def add(self, request, response):
        # 2. Put the sum of request.a and request.b into response.sum.
        # 3. Log a line: self.get_logger().info(...)
        # 4. What does a callback have to do at its end?
        pass


def main():
    rclpy.init()
    node = AddServer()
    # 5. Without this line, no callback ever runs.


if __name__ == "__main__":
    main()
