import taskrpc
from my_robot_interfaces.srv import RobotTask
from taskrpc import sync

request = RobotTask.Request(task_type="report", target="central", priority=5)

with sync.Node("operator") as node:
    client = node.create_client(RobotTask, "robot_task")
    try:
        response = client.call(request, timeout=1.5, request_id="monday-1")
    except taskrpc.DeadlineExceeded:
        print("no response after 1.5 s: I ask again, with the same id")
        response = client.call(request, timeout=3.0, request_id="monday-1")
    print("the robot accepted task", response.task_id)
