# The check says: no thread spins /move_client; which line lets the callbacks
import sys
import time
import uuid

import rclpy
from lab4_interfaces.srv import Move
from rclpy.node import Node

ATTEMPTS = @ATTEMPTS@
TIMEOUT = @TIMEOUT@
FIRST_WAIT = @FIRST_WAIT@


class MoveClient(Node):
    def __init__(self):
        super().__init__("move_client")
        self.client = self.create_client(Move, "@SERVICE@")

    def send_once(self, request):
        future = self.client.call_async(request)
        end = time.monotonic() + TIMEOUT
        while not future.done() and time.monotonic() < end:
            time.sleep(0.01)
        if not future.done():
            return None
        try:
            return future.result()
        except Exception as error:  # on a real ROS 2, a call has no errors
            self.get_logger().warn(f"the call failed: {error}")
            return None

    def move(self, target):
        request = Move.Request(target=target, request_id=str(uuid.uuid4()))
        for attempt in range(ATTEMPTS):
            if attempt > 0:
                time.sleep(FIRST_WAIT * 2 ** (attempt - 1))
            response = self.send_once(request)
            if response is not None:
                return response
            self.get_logger().warn(f"attempt {attempt + 1} of {ATTEMPTS}: no response")
        self.get_logger().error(f"{target}: no response after {ATTEMPTS} attempts")
        return None


def main():
    rclpy.init()
    node = MoveClient()
    for target in sys.argv[1:]:
        response = node.move(target)
        print(f"{target}: {response.message if response else 'no response'}")
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
