"""Lab 1: calls the service. Start it with two numbers: taskrpc run client.py 2 3"""

import sys

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddClient(Node):
    def __init__(self):
        super().__init__("add_client")
        # 6. Create a client: self.client = self.create_client(type, name)
        #    The type and the name are those of the server: AddTwoInts and "@SERVICE@".
        # 7. Wait until a server offers the service. self.client.wait_for_service(timeout_sec=1.0)
        #    waits for at most a second, and returns True or False: repeat it until it is True.

    def send_request(self, a, b):
        request = AddTwoInts.Request(a=a, b=b)
        # 8. Send the request: future = self.client.call_async(request)
        # 9. The response is not there yet. Let rclpy run until the future is complete.
        # 10. Return the result of the future.


def main():
    rclpy.init()
    node = AddClient()
    a, b = int(sys.argv[1]), int(sys.argv[2])
    response = node.send_request(a, b)
    print(f"{a} + {b} = {response.sum}")
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
