import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(String, "command", self.drive, qos)

    def drive(self, message):
        self.get_logger().info(f"drives to the {message.data}")


rclpy.init()
rclpy.spin(Robot())
