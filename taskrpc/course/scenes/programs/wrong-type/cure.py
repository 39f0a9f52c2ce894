import rclpy
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node

rclpy.init()
node = Node("operator")
client = node.create_client(RobotTask, "robot_task")
print("is there a service /robot_task?", client.wait_for_service(timeout_sec=1.0))

request = RobotTask.Request(task_type="report", target="central", priority=5)
future = client.call_async(request)
rclpy.spin_until_future_complete(node, future)
print("the robot accepted task", future.result().task_id)
