import time

import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node


def send_request_with_retry(node, client, request, max_retries=3):
    for attempt in range(max_retries):
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
        if future.done():
            return future.result()
        print("attempt", attempt + 1, "failed, retrying...")
        time.sleep(0.5 * 2**attempt)
    return None


rclpy.init()
node = Node("operator")
client = node.create_client(RobotTask, "robot_task")
client.wait_for_service()
request = RobotTask.Request(task_type="report", target="central", priority=5)
response = send_request_with_retry(node, client, request)
print("I wanted one task, and this is number", response.task_id)
