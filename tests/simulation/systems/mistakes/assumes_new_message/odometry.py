import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64


class Odometry(Node):
    def __init__(self):
        super().__init__("odometry")
        self.turns = []
        self.timer = None
        self.create_subscription(Float64, "turns", self.turned, 10)

    def turned(self, message):
        self.turns.append(message.data)
        if self.timer is None:  # from the first message on
            self.timer = self.create_timer(0.5, self.compute)

    def compute(self):
        mean = sum(self.turns) / len(self.turns)
        self.turns.clear()
        self.get_logger().info(f"speed {mean:.2f}")


rclpy.init()
rclpy.spin(Odometry())
