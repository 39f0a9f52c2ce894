import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

rclpy.init()
node = Node("operator")
client = node.create_client(Trigger, "robot_task")
for _ in range(3):
    print("is there a service /robot_task?", client.wait_for_service(timeout_sec=1.0))
