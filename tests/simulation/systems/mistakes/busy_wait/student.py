import rclpy
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("student")
client = node.create_client(Trigger, "wave")
client.wait_for_service()
future = client.call_async(Trigger.Request())
while not future.done():
    pass
node.get_logger().info(f"waved: {future.result().success}")
rclpy.shutdown()
