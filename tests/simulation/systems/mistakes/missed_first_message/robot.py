import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.create_subscription(String, "map", self.got_map, 10)

    def got_map(self, message):
        self.get_logger().info(f"has the map of the {message.data}")


rclpy.init()
rclpy.spin(Robot())
