# The check says: because no other thread spins /add_client
import sys

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddClient(Node):
    def __init__(self):
        super().__init__("add_client")
        self.client = self.create_client(AddTwoInts, "@SERVICE@")
        while not self.client.wait_for_service(timeout_sec=1.0):
            self.get_logger().info("waiting for the server")

    def send_request(self, a, b):
        request = AddTwoInts.Request(a=a, b=b)
        return self.client.call(request)


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
