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
    spinner = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
    spinner.start()
    began = time.monotonic()
    for a, b in PAIRS:
        request = AddTwoInts.Request(a=a, b=b)
        response = client.call(request)
        print(f"{a} + {b} = {response.sum}")
    print(f"the synchronous calls took {time.monotonic() - began:.1f} s")
    rclpy.shutdown()
    spinner.join()


if __name__ == "__main__":
    main()
