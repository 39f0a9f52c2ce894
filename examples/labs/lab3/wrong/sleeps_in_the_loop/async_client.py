# The check says: it did not tick 12 times within
import time
from functools import partial

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node

PAIRS = @PAIRS@


class AsyncClient(Node):
    def __init__(self):
        super().__init__("async_client")
        self.client = self.create_client(AddTwoInts, "@SERVICE@")
        while not self.client.wait_for_service(timeout_sec=1.0):
            self.get_logger().info("waiting for the server")
        self.timer = self.create_timer(0.25, self.tick)
        self.sums = []

    def tick(self):
        print("tick")

    def send_all(self):
        for a, b in PAIRS:
            request = AddTwoInts.Request(a=a, b=b)
            future = self.client.call_async(request)
            future.add_done_callback(partial(self.show, a, b))

    def show(self, a, b, future):
        response = future.result()
        print(f"{a} + {b} = {response.sum}")
        self.sums.append(response.sum)


def main():
    rclpy.init()
    node = AsyncClient()
    began = time.monotonic()
    node.send_all()
    while len(node.sums) < len(PAIRS):
        rclpy.spin_once(node)
        time.sleep(3)
    print(f"the asynchronous calls took {time.monotonic() - began:.1f} s")
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
