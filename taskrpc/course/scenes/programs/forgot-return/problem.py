import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


def add(request, response):
    response.sum = request.a + request.b
    print("add: the sum is", response.sum)


rclpy.init()
node = Node("adder")
node.create_service(AddTwoInts, "add", add)
future = node.create_client(AddTwoInts, "add").call_async(AddTwoInts.Request(a=2, b=3))
try:
    rclpy.spin_until_future_complete(node, future)
except TypeError as error:
    print("the server ends with TypeError:", error)
rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
print("the caller has a response:", future.done() and future.exception() is None)
