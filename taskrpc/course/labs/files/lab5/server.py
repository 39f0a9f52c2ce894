"""Lab 5: accepts tasks at once, and does them one after another, the most important first."""

import threading
import time
from queue import PriorityQueue

import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

# The types of tasks, and how many seconds each takes.
SECONDS = {"@LONG@": @LONG_SECONDS@, "@MIDDLE@": @MIDDLE_SECONDS@, "@SHORT@": @SHORT_SECONDS@}
TARGETS = ["@TARGET_1@", "@TARGET_2@", "@TARGET_3@"]


class TaskServer(Node):
    def __init__(self):
        super().__init__("task_server")
        self.group = ReentrantCallbackGroup()
        self.queue = PriorityQueue()
        self.lock = threading.Lock()
        self.last_id = 0
        self.busy_until = 0.0
        # 1. Create the service "@SERVICE@" of the type RobotTask.
        #    Its callback is self.handle_task, its callback_group is self.group:
        #    four threads run the callback at the same time.
        # 2. Start a thread that runs self.work. The program must be able to end
        #    although this thread never does: see the argument `daemon`.

    def handle_task(self, request, response):
        # 3. Refuse a task if its type is not in SECONDS, its target not in TARGETS,
        #    or its priority not 1 to 10: success is False, task_id is -1,
        #    estimated_time is 0.0, and the message contains the wrong value.
        # 4. Give an accepted task the next id: 1, 2, 3 and so on. Hold self.lock from
        #    reading the counter to writing it.
        # 5. Put it into the queue as one tuple. A PriorityQueue gives its smallest
        #    tuple first. The task with the highest priority must come first; of two
        #    equal ones, the one that was accepted first.
        # 6. estimated_time is the seconds until this task is done: the rest of the
        #    running task, all waiting tasks that come before it, and its own.
        #    list(self.queue.queue) is what waits.
        # 7. Fill in success, message and task_id, and return the response.
        pass

    def work(self):
        """Do the tasks, one after another, for ever; runs in a thread of its own."""
        # 8. Take the first task out of the queue; self.queue.get() waits for one.
        # 9. Remember in self.busy_until when it will be done: time.monotonic() is now.
        #    Then call self.execute. Do not hold the lock while you wait or work.

    def execute(self, task_id, task_type, target):
        """Do one task. This method is complete; the checks read its two lines."""
        self.get_logger().info(f"Executing task {task_id}: {task_type} - {target}")
        time.sleep(SECONDS[task_type])
        self.get_logger().info(f"Task {task_id} completed")


def main():
    rclpy.init()
    node = TaskServer()
    try:
        rclpy.spin(node, MultiThreadedExecutor(4))
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
