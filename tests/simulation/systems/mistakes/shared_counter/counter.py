import time

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node


class Counter(Node):
    def __init__(self):
        super().__init__("counter")
        self.count = 0
        group = ReentrantCallbackGroup()
        self.create_service(AddTwoInts, "ticket", self.ticket, callback_group=group)

    def ticket(self, request, response):
        number = self.count + 1
        time.sleep(0.05)  # prints the ticket
        self.count = number
        response.sum = number
        return response


rclpy.init()
executor = MultiThreadedExecutor(4)
executor.add_node(Counter())
executor.spin()
