"""Source texts of programs to check: a node with a client, and parts to insert."""

NODE = """import time
import rclpy
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import Int8
from rclpy.node import Node
import threading


class Adder(Node):
    def __init__(self):
        super().__init__("adder")
        self.client = self.create_client(AddTwoInts, "add")
        while not self.client.wait_for_service(timeout_sec=1.0):
            pass
        {setup}

{methods}

def main():
    rclpy.init()
    node = Adder()
    {main}
    rclpy.shutdown()


if __name__ == "__main__":
    main()
"""
TIMER = "self.create_timer(1.0, self.tick)"
SERVICE = 'self.create_service(AddTwoInts, "sum", self.add)'
REQUEST = "AddTwoInts.Request(a=1, b=2)"


def method(head, *lines):
    body = "".join(f"        {line}\n" for line in lines)
    return f"    {head}\n{body}"


def program(setup="pass", methods="", main="rclpy.spin(node)"):
    return NODE.format(setup=setup, methods=methods, main=main)


HELPED = method("def tick(self):", "self.ask()") + method(
    "def ask(self):", f"return self.client.call({REQUEST})"
)


ANSWERS = method(
    "def add(self, request, response):",
    "try:",
    "    if request.a < 0:",
    "        raise ValueError",
    "    response.sum = request.a + request.b",
    "    return response",
    "except ValueError:",
    "    response.sum = -1",
    "return response",
)
AWAITS = method("async def tick(self):", f"await self.client.call_async({REQUEST})")
WAITS = (
    f"for n in range(50):\n        f = self.client.call_async({REQUEST})\n"
    "        rclpy.spin_until_future_complete(node, f)"
)
OVERLAPS = (
    "from rclpy.executors import MultiThreadedExecutor\n"
    "from rclpy.callback_groups import ReentrantCallbackGroup\n"
)
