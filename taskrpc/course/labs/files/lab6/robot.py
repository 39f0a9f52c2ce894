"""Lab 6: the robot, with a battery, a light and a scanner. This program has one fault."""

import time

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
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
        self.offer(Trigger, "scan", self.scan)
        self.get_logger().info("the robot is ready")

    def offer(self, srv_type, name, callback):
        self.create_service(srv_type, name, callback, callback_group=self.group)

    def battery(self, request, response):
        response.success = True
        response.message = @BATTERY@
        return response

    def light(self, request, response):
        self.is_lit = request.data
        @SUCCESS@
        response.message = "the light is on" if self.is_lit else "the light is off"@RETURN@

    async def scan(self, request, response):
        # The scanner needs two seconds.
        @PAUSE@
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
        @SPIN@
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
