import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.create_service(AddTwoInts, "drive_to", self.drive)

    def drive(self, request, response):
        self.get_logger().info(f"drives to {request.a}")
        return response


def main():
    rclpy.init()
    node = Robot()
    rclpy.spin(node)


if __name__ == "__main__":
    main()
