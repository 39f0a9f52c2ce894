import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tf2_ros import TransformBroadcaster


class Broadcaster(Node):
    def __init__(self):
        super().__init__("broadcaster")
        self.broadcaster = TransformBroadcaster(self)
        self.height = 0.0
        self.create_timer(0.25, self.tick)

    def tick(self):
        self.height += 0.1
        transform = TransformStamped()
        transform.header.stamp = self.get_clock().now().to_msg()
        transform.header.frame_id = "base"
        transform.child_frame_id = "arm"
        transform.transform.translation.z = self.height
        self.broadcaster.sendTransform(transform)


def main():
    rclpy.init()
    rclpy.spin(Broadcaster())


if __name__ == "__main__":
    main()
