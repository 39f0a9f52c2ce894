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
    print("the call failed: I tell the user that the robot is broken")
rclpy.spin_until_future_complete(node, future, timeout_sec=4.0)
print("a moment later, the same future says:", future.result().message)
