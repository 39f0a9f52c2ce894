"""Lab 1: calls the service, for example: client.py 2 3"""

import sys

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddClient(Node):
    def __init__(self):
        super().__init__("add_client")
        # 6. Create a client of the service "@SERVICE@".
        # 7. Wait until a server offers it.

    def send_request(self, a, b):
        request = AddTwoInts.Request(a=a, b=b)
        # 8. Send the request with call_async.
        # 9. Let rclpy run until the future is complete, and return the response.


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
