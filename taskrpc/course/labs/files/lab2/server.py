"""Lab 2: a server for your own type of service. Start it with: taskrpc run server.py"""

import rclpy
from @PACKAGE@.srv import @TYPE@
from rclpy.node import Node

SECONDS = {"move": @MOVE@, "scan": @SCAN@, "report": @REPORT@}  # how long each task takes


class TaskServer(Node):
    def __init__(self):
        super().__init__("task_server")
        self.task_counter = 0
        # 9. Create the service "@SERVICE@" of your type. Its callback is self.handle_task.

    def handle_task(self, request, response):
        # 10. If request.@KIND@ is not in SECONDS, refuse the task and return the response:
        #     success is False, message contains the wrong task, task_id is -1,
        #     estimated_time is 0.0.
        # 11. Refuse it in the same way if request.@PRIORITY@ is less than 1, or more than your
        #     constant: @TYPE@.Request.MAX_@PRIORITY_CAPS@. Now message contains the wrong number.
        # 12. Otherwise accept the task: add 1 to self.task_counter, and respond with
        #     success True, a message, the counter as task_id, and the seconds of this task.
        return response


def main():
    rclpy.init()
    node = TaskServer()
    node.get_logger().info("the server is ready")
    rclpy.spin(node)


if __name__ == "__main__":
    main()
