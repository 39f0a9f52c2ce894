import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Doubler(Node):
    def __init__(self):
        super().__init__("doubler")
        self.create_service(AddTwoInts, "add", self.add)
        self.create_service(AddTwoInts, "double", self.double)
        self.client = self.create_client(AddTwoInts, "add")

    def add(self, request, response):
        response.sum = request.a + request.b
        return response

    def double(self, request, response):
        print("double: I call add, and wait for its response")
        response.sum = self.client.call(AddTwoInts.Request(a=request.a, b=request.a)).sum
        return response


rclpy.init()
node = Doubler()
future = node.create_client(AddTwoInts, "double").call_async(AddTwoInts.Request(a=21))
rclpy.spin_until_future_complete(node, future)
print("21 doubled is", future.result().sum)
