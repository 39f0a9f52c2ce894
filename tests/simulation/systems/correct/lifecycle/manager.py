import time

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node


class Manager(Node):
    def __init__(self):
        super().__init__("manager")
        self.client = self.create_client(ChangeState, "sensor/change_state")
        self.client.wait_for_service()

    def change(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        future = self.client.call_async(request)
        rclpy.spin_until_future_complete(self, future, timeout_sec=5.0)
        assert future.result().success


def main():
    rclpy.init()
    manager = Manager()
    manager.change(Transition.TRANSITION_CONFIGURE)
    manager.change(Transition.TRANSITION_ACTIVATE)
    time.sleep(3.0)
    manager.change(Transition.TRANSITION_DEACTIVATE)
    manager.get_logger().info("ready")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
