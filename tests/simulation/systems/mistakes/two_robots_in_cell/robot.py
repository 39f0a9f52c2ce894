import random
import sys
import time

import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool


class Robot(Node):
    def __init__(self):
        super().__init__(sys.argv[1])
        self.cell = self.create_client(SetBool, "cell")
        self.cell.wait_for_service()

    def ask(self, enter):
        future = self.cell.call_async(SetBool.Request(data=enter))
        rclpy.spin_until_future_complete(self, future, timeout_sec=5.0)
        return future.result().success

    def work(self):
        while not self.ask(True):
            time.sleep(0.2)
        self.get_logger().info("enters the cell")
        time.sleep(0.5)
        self.get_logger().info("leaves the cell")
        self.ask(False)


rclpy.init()
robot = Robot()
for _ in range(4):
    robot.work()
    time.sleep(random.uniform(0.5, 1.5))
rclpy.shutdown()
