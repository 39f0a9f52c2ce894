"""Lab 3: three asynchronous calls. Start it with: taskrpc run async_client.py"""

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
            # 5. Send the request with call_async. It returns a future at once: do not wait here.
            # 6. Let rclpy call self.show when the future is complete: add_done_callback takes a
            #    function of one argument, the future. partial(self.show, a, b) is such a function.

    def show(self, a, b, future):
        # 7. Now the future has its result. Print f"{a} + {b} = {...}", and append the sum
        #    to self.sums.
        pass  # replace this line


def main():
    rclpy.init()
    node = AsyncClient()
    began = time.monotonic()
    node.send_all()
    # 8. Run callbacks with rclpy.spin_once(node), again and again, until node.sums has as many
    #    sums as PAIRS has pairs.
    print(f"the asynchronous calls took {time.monotonic() - began:.1f} s")
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
