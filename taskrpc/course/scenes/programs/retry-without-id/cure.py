import time

import taskrpc
from my_robot_interfaces.srv import RobotTask
from taskrpc import sync


def send_request_with_retry(client, request, request_id, max_retries=3):
    for attempt in range(max_retries):
        try:
            return client.call(request, timeout=1.0, request_id=request_id)
        except taskrpc.DeadlineExceeded:
            print("attempt", attempt + 1, "failed, retrying...")
            time.sleep(0.5 * 2**attempt)
    return None


with sync.Node("operator") as node:
    client = node.create_client(RobotTask, "robot_task")
    request = RobotTask.Request(task_type="report", target="central", priority=5)
    response = send_request_with_retry(client, request, "monday-1")
    print("I wanted one task, and this is number", response.task_id)
