import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node
from std_srvs.srv import SetBool


def add(request, response):
    response.sum = request.a + request.b
    return response


rclpy.init()
node = Node("adder")
node.create_service(AddTwoInts, "add", add)

client = node.create_client(SetBool, "add")
for _ in range(3):
    print("is there a service /add?", client.wait_for_service(timeout_sec=1.0))
