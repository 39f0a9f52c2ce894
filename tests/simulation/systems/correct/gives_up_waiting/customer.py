import rclpy
from example_interfaces.srv import AddTwoInts

rclpy.init()
node = rclpy.create_node("customer")
client = node.create_client(AddTwoInts, "cost")
for item in range(5):
    if not client.wait_for_service(timeout_sec=5.0):
        node.get_logger().warning(f"no answer: nobody sells item {item}")
        continue
    future = client.call_async(AddTwoInts.Request(a=item, b=1))
    rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
    if future.done():
        node.get_logger().info(f"item {item} costs {future.result().sum}")
    else:
        client.remove_pending_request(future)
        node.get_logger().warning(f"no answer for item {item}")
rclpy.shutdown()
