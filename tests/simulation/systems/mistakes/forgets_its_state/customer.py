import time

import rclpy
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("customer")
client = node.create_client(Trigger, "buy")
for _ in range(6):
    client.wait_for_service(timeout_sec=5.0)
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
    if not future.done():
        client.remove_pending_request(future)
    time.sleep(0.5)
rclpy.shutdown()
