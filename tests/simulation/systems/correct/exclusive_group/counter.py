import time

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node


class Counter(Node):
    def __init__(self):
        super().__init__("counter")
        self.count = 0
        group = MutuallyExclusiveCallbackGroup()
        self.create_service(AddTwoInts, "ticket", self.ticket, callback_group=group)
        self.create_timer(0.5, self.look)

    def ticket(self, request, response):
        number = self.count + 1
        time.sleep(0.05)  # prints the ticket
        self.count = number
        response.sum = number
        return response

    def look(self):
        time.sleep(0.1)


rclpy.init()
executor = MultiThreadedExecutor(4)
executor.add_node(Counter())
executor.spin()
