import sys
import time

import rclpy
from example_interfaces.srv import AddTwoInts

rclpy.init()
node = rclpy.create_node(sys.argv[1])
client = node.create_client(AddTwoInts, "ticket")
client.wait_for_service()
for _ in range(3):
    future = client.call_async(AddTwoInts.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
    node.get_logger().info(f"ticket {future.result().sum}")
    time.sleep(1.0)
rclpy.shutdown()
