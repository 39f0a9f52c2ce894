import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64


class Wheel(Node):
    def __init__(self):
        super().__init__("wheel")
        self.publisher = self.create_publisher(Float64, "turns", 10)
        self.create_timer(0.4, self.tick)

    def tick(self):
        self.publisher.publish(Float64(data=1.0))


rclpy.init()
rclpy.spin(Wheel())
