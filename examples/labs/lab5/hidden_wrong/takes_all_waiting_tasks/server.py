# The check says: an urgent task overtakes waiting ones
import threading
import time
from queue import PriorityQueue

import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

SECONDS = {"@LONG@": @LONG_SECONDS@, "@MIDDLE@": @MIDDLE_SECONDS@, "@SHORT@": @SHORT_SECONDS@}
TARGETS = ["@TARGET_1@", "@TARGET_2@", "@TARGET_3@"]


class TaskServer(Node):
    def __init__(self):
        super().__init__("task_server")
        group = ReentrantCallbackGroup()
        self.queue = PriorityQueue()
        self.lock = threading.Lock()
        self.last_id = 0
        self.busy_until = 0.0
        self.srv = self.create_service(RobotTask, "@SERVICE@", self.handle_task, callback_group=group)
        threading.Thread(target=self.work, daemon=True).start()

    def handle_task(self, request, response):
        problem = self.problem_of(request)
        if problem:
            response.success = False
            response.message = problem
            response.task_id = -1
            response.estimated_time = 0.0
            return response
        with self.lock:
            self.last_id += 1
            task = (-request.priority, self.last_id, request.task_type, request.target)
            ahead = [waiting for waiting in list(self.queue.queue) if waiting < task]
            rest = max(0.0, self.busy_until - time.monotonic())
            self.queue.put(task)
        response.success = True
        response.message = f"Task queued: {request.task_type}"
        response.task_id = task[1]
        response.estimated_time = rest + sum(SECONDS[one[2]] for one in [*ahead, task])
        return response

    def problem_of(self, request):
        if request.task_type not in SECONDS:
            return f"Invalid task: {request.task_type}"
        if request.target not in TARGETS:
            return f"Invalid target: {request.target}"
        if not 1 <= request.priority <= 10:
            return f"Invalid priority: {request.priority}"
        return ""

    def work(self):
        while True:
            batch = [self.queue.get()]
            while not self.queue.empty():
                batch.append(self.queue.get())
            for _, task_id, task_type, target in batch:
                self.busy_until = time.monotonic() + SECONDS[task_type]
                self.execute(task_id, task_type, target)

    def execute(self, task_id, task_type, target):
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
