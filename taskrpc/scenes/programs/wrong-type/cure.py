import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


def add(request, response):
    response.sum = request.a + request.b
    return response


rclpy.init()
node = Node("adder")
node.create_service(AddTwoInts, "add", add)

client = node.create_client(AddTwoInts, "add")
print("is there a service /add?", client.wait_for_service(timeout_sec=1.0))
future = client.call_async(AddTwoInts.Request(a=2, b=3))
rclpy.spin_until_future_complete(node, future)
print("2 + 3 =", future.result().sum)
