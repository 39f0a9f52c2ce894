# The check says: two scans at the same time to take as long as one
"""Lab 6: the robot, with a battery, a light and a scanner."""

import time

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger


class Robot(Node):
    def __init__(self):
        super().__init__("robot", namespace="@ROBOT@")
        self.percent = 87
        self.is_lit = False
        self.group = ReentrantCallbackGroup()
        self.offer(Trigger, "battery", self.battery)
        self.offer(SetBool, "light", self.light)
        self.create_service(
            Trigger, "scan", self.scan, callback_group=MutuallyExclusiveCallbackGroup()
        )
        self.get_logger().info("the robot is ready")

    def offer(self, srv_type, name, callback):
        self.create_service(srv_type, name, callback, callback_group=self.group)

    def battery(self, request, response):
        response.success = True
        response.message = f"{self.percent} percent"
        return response

    def light(self, request, response):
        self.is_lit = request.data
        response.success = True
        response.message = "the light is on" if self.is_lit else "the light is off"
        return response

    async def scan(self, request, response):
        # The scanner needs two seconds.
        await self.pause(2.0)
        response.success = True
        response.message = "3 objects"
        return response

    async def pause(self, seconds):
        """Wait; other callbacks can run meanwhile."""
        over = Future()
        timer = self.create_timer(seconds, lambda: over.set_result(None), self.group)
        await over
        self.destroy_timer(timer)


def main():
    rclpy.init()
    node = Robot()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
