import rclpy
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from std_msgs.msg import Float64


class Sensor(LifecycleNode):
    def __init__(self):
        super().__init__("sensor")
        self.publisher = None

    def on_configure(self, state):
        self.publisher = self.create_lifecycle_publisher(Float64, "distance", 10)
        self.get_logger().info("is configured")
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state):
        self.get_logger().info("is active")
        self.timer = self.create_timer(0.5, self.measure)
        return super().on_activate(state)

    def on_deactivate(self, state):
        self.destroy_timer(self.timer)
        self.get_logger().info("is inactive")
        return super().on_deactivate(state)

    def measure(self):
        self.publisher.publish(Float64(data=1.5))


def main():
    rclpy.init()
    rclpy.spin(Sensor())


if __name__ == "__main__":
    main()
