import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Camera(Node):
    def __init__(self):
        super().__init__("camera")
        self.publisher = self.create_publisher(String, "seen", 10)
        self.create_timer(0.2, self.look)

    def look(self):
        self.publisher.publish(String(data="cup"))


rclpy.init()
rclpy.spin(Camera())
