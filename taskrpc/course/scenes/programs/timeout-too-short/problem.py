import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node

rclpy.init()
node = Node("operator")
client = node.create_client(RobotTask, "robot_task")
client.wait_for_service()
request = RobotTask.Request(task_type="report", target="central", priority=5)

for attempt in (1, 2):
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.4)
    print("attempt", attempt, "worked" if future.done() else "timed out")
rclpy.spin_until_future_complete(node, future, timeout_sec=3.0)
