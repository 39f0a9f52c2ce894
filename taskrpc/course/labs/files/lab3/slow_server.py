"""Lab 3: a service that needs one second for each sum. It is complete: change nothing here.

Start it with: taskrpc run slow_server.py
"""

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

SECONDS = 1.0


class SlowServer(Node):
    def __init__(self):
        super().__init__("slow_server")
        # This group lets rclpy begin a request while others wait for their second to pass.
        group = ReentrantCallbackGroup()
        self.srv = self.create_service(AddTwoInts, "@SERVICE@", self.add, callback_group=group)

    async def add(self, request, response):
        self.get_logger().info(f"begins {request.a} + {request.b}")
        await self.pause(SECONDS)
        response.sum = request.a + request.b
        return response

    async def pause(self, seconds):
        """Wait without blocking: other callbacks run meanwhile, which time.sleep would prevent."""
        future = Future()
        timer = self.create_timer(seconds, lambda: future.set_result(True))
        await future
        self.destroy_timer(timer)


def main():
    rclpy.init()
    node = SlowServer()
    node.get_logger().info("the server is ready")
    rclpy.spin(node)


if __name__ == "__main__":
    main()
