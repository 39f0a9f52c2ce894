import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node


class Doubler(Node):
    def __init__(self):
        super().__init__("doubler")
        group = ReentrantCallbackGroup()
        self.create_service(AddTwoInts, "add", self.add, callback_group=group)
        self.create_service(AddTwoInts, "double", self.double, callback_group=group)
        self.client = self.create_client(AddTwoInts, "add", callback_group=group)

    def add(self, request, response):
        response.sum = request.a + request.b
        return response

    async def double(self, request, response):
        print("double: I call add, and the thread is free while I wait")
        result = await self.client.call_async(AddTwoInts.Request(a=request.a, b=request.a))
        response.sum = result.sum
        return response


rclpy.init()
node = Doubler()
future = node.create_client(AddTwoInts, "double").call_async(AddTwoInts.Request(a=21))
rclpy.spin_until_future_complete(node, future)
print("21 doubled is", future.result().sum)
