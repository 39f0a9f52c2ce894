"""Lab 6: the planner, which carries out a mission with the robot. This program has one fault."""

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger


class Planner(Node):
    def __init__(self):
        super().__init__("planner")
        group = ReentrantCallbackGroup()
        self.battery = self.create_client(Trigger, "@BATTERY_NAME@", callback_group=group)
        self.scan = self.create_client(Trigger, "/@ROBOT@/scan", callback_group=group)
        self.create_service(Trigger, "/mission", self.mission, callback_group=group)@SECOND_SERVER@
        self.get_logger().info("the planner is ready")

    @MISSION@
        response.success = True
        response.message = f"battery: {battery.message}; scan: {scan.message}"
        return response@SECOND_CALLBACK@


def main():
    rclpy.init()
    node = Planner()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
