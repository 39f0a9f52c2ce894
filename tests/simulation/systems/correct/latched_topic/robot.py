import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(String, "map", self.got_map, qos)

    def got_map(self, message):
        self.get_logger().info(f"has the map of the {message.data}")


rclpy.init()
rclpy.spin(Robot())
