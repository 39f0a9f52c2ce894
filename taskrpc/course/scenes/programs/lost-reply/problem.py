import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node

rclpy.init()
node = Node("operator")
client = node.create_client(RobotTask, "robot_task")
client.wait_for_service()

request = RobotTask.Request(task_type="report", target="central", priority=5)
future = client.call_async(request)
rclpy.spin_until_future_complete(node, future, timeout_sec=1.5)
if future.done():
    print("the robot accepted task", future.result().task_id)
else:
    print("no response after 1.5 s: will the robot drive, or not?")
