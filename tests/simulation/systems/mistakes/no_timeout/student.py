import rclpy
from std_srvs.srv import SetBool


def main():
    rclpy.init()
    node = rclpy.create_node("student")
    client = node.create_client(SetBool, "gripper")
    client.wait_for_service()
    for number in range(6):
        future = client.call_async(SetBool.Request(data=number % 2 == 0))
        rclpy.spin_until_future_complete(node, future)
        node.get_logger().info(f"grip {number}: {future.result().success}")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
