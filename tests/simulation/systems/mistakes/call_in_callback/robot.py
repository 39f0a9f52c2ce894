import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.arm = self.create_client(Trigger, "move_arm")
        self.create_service(Trigger, "fetch", self.fetch)

    def fetch(self, request, response):
        self.arm.wait_for_service()
        moved = self.arm.call(Trigger.Request())
        response.success = moved.success
        return response


rclpy.init()
rclpy.spin(Robot())
