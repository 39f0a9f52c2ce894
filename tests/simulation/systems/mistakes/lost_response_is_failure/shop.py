import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Shop(Node):
    def __init__(self):
        super().__init__("shop")
        self.client = self.create_client(AddTwoInts, "deliver")
        self.client.wait_for_service()

    def sell(self, order):
        future = self.client.call_async(AddTwoInts.Request(a=order))
        rclpy.spin_until_future_complete(self, future, timeout_sec=2.0)
        if not future.done():
            self.get_logger().info(f"pays back order {order}")


rclpy.init()
shop = Shop()
for order in range(5):
    shop.sell(order)
rclpy.shutdown()
