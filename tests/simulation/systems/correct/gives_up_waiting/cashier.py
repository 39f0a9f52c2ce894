import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Cashier(Node):
    def __init__(self):
        super().__init__("cashier")
        self.create_service(AddTwoInts, "cost", self.add_up)

    def add_up(self, request, response):
        response.sum = request.a + request.b
        return response


rclpy.init()
rclpy.spin(Cashier())
