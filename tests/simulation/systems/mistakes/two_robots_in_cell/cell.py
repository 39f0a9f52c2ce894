import rclpy
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool


class Cell(Node):
    def __init__(self):
        super().__init__("cell")
        self.is_taken = False
        self.is_paused = False
        self.create_service(SetBool, "cell", self.reserve)
        self.create_subscription(Bool, "pause", self.pause, 10)

    def reserve(self, request, response):
        if not request.data:
            self.is_taken = False
        elif not self.is_taken and not self.is_paused:
            self.is_taken = True
            response.success = True
        return response

    def pause(self, message):
        self.is_paused = message.data
        self.is_taken = False
        self.get_logger().info("pauses" if message.data else "resumes")


rclpy.init()
rclpy.spin(Cell())
