# The check says: it called nothing; its log says: [taskrpc] ROS 2 would lose this request
"""Lab 6: the planner, which carries out a mission with the robot."""

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger


class Planner(Node):
    def __init__(self):
        super().__init__("planner")
        group = ReentrantCallbackGroup()
        self.battery = self.create_client(Trigger, "battery", callback_group=group)
        self.scan = self.create_client(Trigger, "/@ROBOT@/scan", callback_group=group)
        self.create_service(Trigger, "/mission", self.mission, callback_group=group)
        self.get_logger().info("the planner is ready")

    async def mission(self, request, response):
        battery = await self.battery.call_async(Trigger.Request())
        scan = await self.scan.call_async(Trigger.Request())
        response.success = True
        response.message = f"battery: {battery.message}; scan: {scan.message}"
        return response


def main():
    rclpy.init()
    node = Planner()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
