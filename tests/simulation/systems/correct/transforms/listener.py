import rclpy
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import Buffer, TransformException, TransformListener


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.create_timer(1.0, self.look)

    def look(self):
        try:
            found = self.buffer.lookup_transform("base", "arm", Time())
        except TransformException as error:
            self.get_logger().info(f"does not know the arm yet: {error}")
            return
        self.get_logger().info(f"the arm is at {found.transform.translation.z:.2f}")


def main():
    rclpy.init()
    rclpy.spin(Listener())


if __name__ == "__main__":
    main()
