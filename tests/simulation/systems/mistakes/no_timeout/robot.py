import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.create_service(SetBool, "gripper", self.grip)

    def grip(self, request, response):
        self.get_logger().info("closes" if request.data else "opens")
        response.success = True
        return response


def main():
    rclpy.init()
    rclpy.spin(Robot())


if __name__ == "__main__":
    main()
