import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.declare_parameter("speed", 0.5)
        self.add_on_set_parameters_callback(self.check)
        self.create_timer(1.0, self.drive)

    def check(self, parameters):
        return SetParametersResult(successful=all(each.value <= 2.0 for each in parameters))

    def drive(self):
        self.get_logger().info(f"speed {self.get_parameter('speed').value}")


def main():
    rclpy.init()
    rclpy.spin(Robot())


if __name__ == "__main__":
    main()
