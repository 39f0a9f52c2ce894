import time

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


handled = []


def add(request, response):
    handled.append(request.a)
    response.sum = request.a + request.b
    return response


rclpy.init()
node = Node("adder")
node.create_service(AddTwoInts, "add", add)
client = node.create_client(AddTwoInts, "add")

futures = [client.call_async(AddTwoInts.Request(a=number, b=0)) for number in range(1, 13)]
time.sleep(0.5)  # all requests have arrived, and wait
for future in futures:
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.3)
print("add has handled", *handled)
print("responses:", sum(future.done() for future in futures), "of", len(futures))
