import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node

rclpy.init()
node = Node("operator")
client = node.create_client(RobotTask, "robot_task")
client.wait_for_service()

request = RobotTask.Request(task_type="report", target="central", priority=5)
future = client.call_async(request)
rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
if not future.done():
    print("no response yet: the robot may still accept the task")
    rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
print("the robot accepted task", future.result().task_id)
