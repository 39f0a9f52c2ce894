import rclpy
from action_msgs.msg import GoalStatus
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient
from rclpy.node import Node

NAMES = {GoalStatus.STATUS_SUCCEEDED: "SUCCEEDED", GoalStatus.STATUS_CANCELED: "CANCELED"}


class Student(Node):
    def __init__(self):
        super().__init__("student")
        self.client = ActionClient(self, Fibonacci, "drive")
        self.client.wait_for_server()

    def drive(self, order):
        sent = self.client.send_goal_async(Fibonacci.Goal(order=order))
        rclpy.spin_until_future_complete(self, sent)
        handle = sent.result()
        result = handle.get_result_async()
        rclpy.spin_until_future_complete(self, result, timeout_sec=1.2)
        if not result.done():
            cancel = handle.cancel_goal_async()
            rclpy.spin_until_future_complete(self, cancel)
            rclpy.spin_until_future_complete(self, result)
        self.get_logger().info(f"{order} {NAMES[result.result().status]}")


def main():
    rclpy.init()
    student = Student()
    for order in (3, 4, 5, 8):
        student.drive(order)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
