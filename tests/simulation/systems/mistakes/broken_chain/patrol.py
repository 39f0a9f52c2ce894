import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Patrol(Node):
    def __init__(self):
        super().__init__("patrol")
        self.client = self.create_client(AddTwoInts, "drive")
        self.client.wait_for_service()
        self.place = 0
        self.drive()

    def drive(self):
        self.place += 1
        future = self.client.call_async(AddTwoInts.Request(a=self.place))
        future.add_done_callback(self.arrived)

    def arrived(self, future):
        self.get_logger().info(f"is at {self.place}")
        if self.place < 6:
            self.drive()


rclpy.init()
rclpy.spin(Patrol())
