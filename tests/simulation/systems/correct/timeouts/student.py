import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class Student(Node):
    def __init__(self):
        super().__init__("student")
        self.client = self.create_client(AddTwoInts, "drive_to")
        while not self.client.wait_for_service(timeout_sec=1.0):
            self.get_logger().info("waits for the robot")

    def drive(self, number):
        while True:
            future = self.client.call_async(AddTwoInts.Request(a=number))
            rclpy.spin_until_future_complete(self, future, timeout_sec=1.0)
            if future.done():
                self.get_logger().info(f"is at {number}")
                return
            self.client.remove_pending_request(future)


def main():
    rclpy.init()
    student = Student()
    for number in range(5):
        student.drive(number)
    student.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
