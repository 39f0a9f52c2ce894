# The check says: the requests had no request_id
import sys
import time

import rclpy
from lab4_interfaces.srv import Move
from rclpy.node import Node


class MoveClient(Node):
    def __init__(self):
        super().__init__("move_client")
        self.client = self.create_client(Move, "@SERVICE@")

    def send_request_with_retry(self, request, max_retries=3):
        for attempt in range(max_retries):
            try:
                future = self.client.call_async(request)
                rclpy.spin_until_future_complete(self, future, timeout_sec=@TIMEOUT@)
                if future.done():
                    response = future.result()
                    if response:
                        return response
                self.get_logger().warn(f"Attempt {attempt + 1} failed, retrying...")
            except Exception as error:
                self.get_logger().error(f"Attempt {attempt + 1} error: {error}")
            time.sleep(2**attempt)
        self.get_logger().error("All retry attempts failed")
        return None


def main():
    rclpy.init()
    node = MoveClient()
    for target in sys.argv[1:]:
        response = node.send_request_with_retry(Move.Request(target=target))
        print(f"{target}: {response.message if response else 'no response'}")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
