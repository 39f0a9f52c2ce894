import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient


def main():
    rclpy.init()
    node = Node("tuner")
    client = AsyncParameterClient(node, "robot")
    client.wait_for_services()
    for speed in 1.5, 9.0:
        future = client.set_parameters([Parameter("speed", value=speed)])
        rclpy.spin_until_future_complete(node, future)
        node.get_logger().info(f"set to {speed}: {future.result().results[0].successful}")
    future = client.get_parameters(["speed"])
    rclpy.spin_until_future_complete(node, future)
    node.get_logger().info(f"reads {future.result().values[0].double_value}")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
