"""Lab 3: three synchronous calls. Start it with: taskrpc run sync_client.py"""

import threading
import time

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node

PAIRS = @PAIRS@


def main():
    rclpy.init()
    node = Node("sync_client")
    client = node.create_client(AddTwoInts, "@SERVICE@")
    while not client.wait_for_service(timeout_sec=1.0):
        node.get_logger().info("waiting for the server")
    # 1. client.call waits in this thread. Another thread must receive the response meanwhile:
    #    create spinner = threading.Thread(...) with target=rclpy.spin, args=(node,), daemon=True,
    #    and start it.
    began = time.monotonic()
    for a, b in PAIRS:
        request = AddTwoInts.Request(a=a, b=b)
        # 2. Call the service: response = client.call(request)
        # 3. Print the numbers and the sum: f"{a} + {b} = {response.sum}"
    print(f"the synchronous calls took {time.monotonic() - began:.1f} s")
    rclpy.shutdown()
    # 4. Now the other thread ends. Wait for its end: spinner.join()


if __name__ == "__main__":
    main()
