import rclpy
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.seen = None
        self.create_subscription(String, "seen", self.see, 10)
        self.create_service(Trigger, "grasp", self.grasp)

    def see(self, message):
        self.seen = message

    def grasp(self, request, response):
        response.message = f"has the {self.seen.data}"
        response.success = True
        return response


rclpy.init()
rclpy.spin(Robot())
