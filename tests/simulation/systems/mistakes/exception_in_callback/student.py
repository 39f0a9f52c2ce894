import time

import rclpy
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("student")
client = node.create_client(Trigger, "grasp")
client.wait_for_service()
time.sleep(0.5)  # the camera needs a moment
future = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
if future.done():
    node.get_logger().info(future.result().message)
rclpy.shutdown()
