import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger


class Arm(Node):
    def __init__(self):
        super().__init__("arm")
        self.create_service(Trigger, "move_arm", self.move)

    def move(self, request, response):
        self.get_logger().info("moves")
        response.success = True
        return response


rclpy.init()
rclpy.spin(Arm())
