"""Lab 1: a service that adds two integers. Start it with: taskrpc run server.py"""

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddServer(Node):
    def __init__(self):
        super().__init__("add_server")  # the name of the node
        # 1. Create the service: self.srv = self.create_service(type, name, callback)
        #    The type is AddTwoInts, the name is "@SERVICE@", the callback is self.add.
        #    Write self.add without (): rclpy calls it, once for each request.

    def add(self, request, response):
        # 2. Put the sum of request.a and request.b into response.sum.
        # 3. Log both numbers and the sum: self.get_logger().info(f"...")
        # 4. The client waits for the response. What must this method do with it at its end?
        pass  # replace this line


def main():
    rclpy.init()
    node = AddServer()
    node.get_logger().info("the server is ready")
    # 5. Let rclpy run the callbacks of the node until Ctrl-C. Which line of the slide does it?


if __name__ == "__main__":
    main()
