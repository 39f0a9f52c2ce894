import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String


class Pilot(Node):
    def __init__(self):
        super().__init__("pilot")
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.publisher = self.create_publisher(String, "command", qos)
        self.publisher.publish(String(data="ramp"))


rclpy.init()
rclpy.spin(Pilot())
