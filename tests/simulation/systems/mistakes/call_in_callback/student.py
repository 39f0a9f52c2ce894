import rclpy
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("student")
client = node.create_client(Trigger, "fetch")
client.wait_for_service()
future = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
node.get_logger().info(f"fetched: {future.done()}")
rclpy.shutdown()
