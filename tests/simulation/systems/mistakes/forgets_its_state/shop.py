import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger


class Shop(Node):
    def __init__(self):
        super().__init__("shop")
        self.stock = 3
        self.create_service(Trigger, "buy", self.buy)

    def buy(self, request, response):
        response.success = self.stock > 0
        if self.stock > 0:
            self.stock -= 1
            self.get_logger().info("sells")
        return response


rclpy.init()
rclpy.spin(Shop())
