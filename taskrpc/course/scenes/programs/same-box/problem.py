import random
import time

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger


class Shop(Node):
    def __init__(self):
        super().__init__("shop")
        self.boxes = ["box A", "box B"]
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, "pick", self.pick, callback_group=group)

    def pick(self, request, response):
        response.message = self.boxes[0]
        time.sleep(0.1)  # the camera looks for the box
        self.boxes = self.boxes[1:]
        return response


class Customer(Node):
    def __init__(self, name):
        super().__init__(name)
        self.client = self.create_client(Trigger, "pick")
        self.timer = self.create_timer(random.uniform(0.2, 2.0), self.order)
        self.box = None

    def order(self):
        self.timer.cancel()
        self.client.call_async(Trigger.Request()).add_done_callback(self.receive)

    def receive(self, future):
        self.box = future.result().message
        print(self.get_name(), "gets", self.box)


rclpy.init()
customers = [Customer("ada"), Customer("ben")]
executor = MultiThreadedExecutor(4)
for node in (Shop(), *customers):
    executor.add_node(node)
while not all(each.box for each in customers):
    executor.spin_once(timeout_sec=0.1)
