"""Lab 4: moves the robot to one target after another, for example: client.py @TARGET@"""

import sys
import time
import uuid

import rclpy
from lab4_interfaces.srv import Move
from rclpy.node import Node

ATTEMPTS = @ATTEMPTS@
TIMEOUT = @TIMEOUT@  # seconds that one attempt waits for its response
FIRST_WAIT = @FIRST_WAIT@  # seconds between the first and the second attempt


class MoveClient(Node):
    def __init__(self):
        super().__init__("move_client")
        self.client = self.create_client(Move, "@SERVICE@")

    def send_once(self, request):
        """Return the response; None if none arrives within TIMEOUT seconds."""
        # 1. Send the request with call_async.
        # 2. Let rclpy run until the future is complete, but at most TIMEOUT seconds.
        # 3. Return the response if there is one, otherwise None.

    def move(self, target):
        """Return the response; None if there is none after ATTEMPTS attempts."""
        request = Move.Request(target=target)
        # 4. Put an id into request.request_id; each str(uuid.uuid4()) is a new one.
        #    Does this line belong before the loop over the attempts, or into it?
        # 5. Write a loop over the attempts. Each calls send_once. If there is a
        #    response, return it: also a response with success=False is a response.
        # 6. If there is none, log a warning, and wait with time.sleep: FIRST_WAIT
        #    seconds before the second attempt, then each time twice as long.
        # 7. After the last attempt do not wait. Log one line with
        #    self.get_logger().error(...): the target and how many attempts there were.


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
