# The check says: refused tasks used up ids
import threading
import time
from queue import PriorityQueue

import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node

SECONDS = {"@LONG@": @LONG_SECONDS@, "@MIDDLE@": @MIDDLE_SECONDS@, "@SHORT@": @SHORT_SECONDS@}


class TaskManagementServer(Node):
    def __init__(self):
        super().__init__("task_management_server")
        self.srv = self.create_service(RobotTask, "@SERVICE@", self.handle_task_request)
        self.task_queue = PriorityQueue()
        self.task_counter = 0
        self.lock = threading.Lock()
        self.processor_thread = threading.Thread(target=self.process_tasks, daemon=True)
        self.processor_thread.start()

    def handle_task_request(self, request, response):
        with self.lock:
            self.task_counter += 1
            task_id = self.task_counter
        problem = ""
        if request.task_type not in SECONDS:
            problem = f"Invalid task: {request.task_type}"
        elif request.target not in ["@TARGET_1@", "@TARGET_2@", "@TARGET_3@"]:
            problem = f"Invalid target: {request.target}"
        elif request.priority not in range(1, 11):
            problem = f"Invalid priority: {request.priority}"
        if problem:
            response.success = False
            response.message = problem
            response.task_id = -1
            response.estimated_time = 0.0
            return response
        task_data = {"id": task_id, "type": request.task_type, "target": request.target}
        self.task_queue.put((-request.priority, task_id, task_data))
        response.success = True
        response.message = f"Task queued: {request.task_type}"
        response.task_id = task_id
        response.estimated_time = SECONDS[request.task_type]
        return response

    def process_tasks(self):
        while True:
            if not self.task_queue.empty():
                _, task_id, task_data = self.task_queue.get()
                self.execute_task(task_data)
            time.sleep(0.1)

    def execute_task(self, task_data):
        self.get_logger().info(
            f'Executing task {task_data["id"]}: {task_data["type"]} - {task_data["target"]}'
        )
        time.sleep(SECONDS[task_data["type"]])
        self.get_logger().info(f'Task {task_data["id"]} completed')


def main():
    rclpy.init()
    server = TaskManagementServer()
    rclpy.spin(server)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
