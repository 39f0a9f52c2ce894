# The check says: there was none within 8 s; no thread spins /task_server
import time

import rclpy
from @PACKAGE@.srv import @TYPE@
from rclpy.node import Node

SECONDS = {"move": @MOVE@, "scan": @SCAN@, "report": @REPORT@}


class TaskServer(Node):
    def __init__(self):
        super().__init__("task_server")
        self.task_counter = 0
        self.srv = self.create_service(@TYPE@, "@SERVICE@", self.handle_task)

    def handle_task(self, request, response):
        if request.@KIND@ not in SECONDS:
            return self.refuse(response, f"invalid task: {request.@KIND@}")
        if not 1 <= request.@PRIORITY@ <= @TYPE@.Request.MAX_@PRIORITY_CAPS@:
            return self.refuse(response, f"invalid @PRIORITY@: {request.@PRIORITY@}")
        self.task_counter += 1
        response.success = True
        response.message = f"task queued: {request.@KIND@}"
        response.task_id = self.task_counter
        response.estimated_time = SECONDS[request.@KIND@]
        return response

    def refuse(self, response, message):
        response.success = False
        response.message = message
        response.task_id = -1
        response.estimated_time = 0.0
        return response


def main():
    rclpy.init()
    node = TaskServer()
    node.get_logger().info("the server is ready")
    while rclpy.ok():
        time.sleep(0.1)


if __name__ == "__main__":
    main()
