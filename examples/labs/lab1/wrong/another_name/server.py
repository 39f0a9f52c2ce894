# The check says: it offers /add_two_numbers (example_interfaces/srv/AddTwoInts); compare name and type
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddServer(Node):
    def __init__(self):
        super().__init__("add_server")
        self.srv = self.create_service(AddTwoInts, "add_two_numbers", self.add)

    def add(self, request, response):
        response.sum = request.a + request.b
        self.get_logger().info(f"{request.a} + {request.b} = {response.sum}")
        return response


def main():
    rclpy.init()
    node = AddServer()
    node.get_logger().info("the server is ready")
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
