import time

import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node

rclpy.init()
node = Node("operator")
client = node.create_client(RobotTask, "robot_task")
client.wait_for_service()

request = RobotTask.Request(task_type="report", target="central", priority=5)
future = client.call_async(request)
while not future.done():
    print("not done yet")
    time.sleep(2.0)
print("the robot accepted task", future.result().task_id)
