import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.create_service(AddTwoInts, "drive", self.drive)

    def drive(self, request, response):
        self.get_logger().info(f"drives to {request.a}")
        return response


rclpy.init()
rclpy.spin(Robot())
