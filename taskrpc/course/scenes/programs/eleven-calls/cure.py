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

done = 0
for number in range(1, 13):
    future = client.call_async(AddTwoInts.Request(a=number, b=0))
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.3)
    done += future.done()
print("add has handled", *handled)
print("responses:", done, "of 12")
