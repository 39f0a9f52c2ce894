"""Lab 6: the operator's console: light on, then a mission. This program has one fault."""

import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger


class Console(Node):
    def __init__(self):
        super().__init__("console")
        self.light = self.create_client(@LIGHT_TYPE@, "@LIGHT_NAME@")
        self.mission = self.create_client(Trigger, "/mission")

    def call(self, client, request):
        """Return the response; None if there is no server, or no response in time."""
        if not client.wait_for_service(timeout_sec=5.0):
            self.get_logger().error(f"no server offers {client.srv_name}")
            return None
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self, future, timeout_sec=@TIMEOUT@)
        if not future.done():
            self.get_logger().error(f"no response of {client.srv_name}")
            return None
        return future.result()


def show(name, response):
    print(f"{name}: {response.message if response else 'no response'}")


def main():
    rclpy.init()
    node = Console()
    show("light", node.call(node.light, @LIGHT_REQUEST@))
    show("mission", node.call(node.mission, Trigger.Request()))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
