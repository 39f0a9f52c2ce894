"""Lab 4: a robot whose first responses get lost, for example: robot.py 2

This file is complete. Read it, and leave it as it is.
"""

import sys

import rclpy
from lab4_interfaces.srv import Move
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future


class Robot(Node):
    def __init__(self, lose):
        super().__init__("robot")
        self.lose = lose
        self.done = {}
        group = ReentrantCallbackGroup()
        self.srv = self.create_service(Move, "@SERVICE@", self.move, callback_group=group)
        self.get_logger().info("ready")

    async def move(self, request, response):
        if request.request_id in self.done:
            self.get_logger().info("I know this request_id: I do not move again")
        else:
            self.get_logger().info(f"I move to {request.target}")
        if request.request_id:
            self.done[request.request_id] = request.target
        if self.lose > 0:
            self.lose -= 1
            self.get_logger().info("my response gets lost")
            await Future()  # nobody completes this future, so no response is sent
        response.success = True
        response.message = f"the robot is at {request.target}"
        return response


def main():
    rclpy.init()
    node = Robot(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
