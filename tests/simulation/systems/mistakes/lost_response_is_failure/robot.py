import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.create_service(AddTwoInts, "deliver", self.deliver)

    def deliver(self, request, response):
        self.get_logger().info(f"delivers order {request.a}")
        return response


rclpy.init()
rclpy.spin(Robot())
