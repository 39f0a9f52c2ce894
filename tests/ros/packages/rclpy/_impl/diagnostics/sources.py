"""The source of programs for the tests of this folder, and the lines that explain them."""

from __future__ import annotations

HEAD = """
import sys, threading, time
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from example_interfaces.srv import AddTwoInts
from nav_msgs.srv import LoadMap
REQUEST = AddTwoInts.Request(a=1, b=2)


def add(request, response):
    response.sum = request.a + request.b
    return response


def ask(service, seconds=1.0):
    future = node.create_client(AddTwoInts, service).call_async(REQUEST)
    rclpy.spin_until_future_complete(node, future, timeout_sec=seconds)
    return future


rclpy.init()
node = Node("n")
"""


SOONER = """
from rclpy._impl.diagnostics import watchdog as dog
assert (dog._PERIOD, dog._SOON, dog._LATE, dog._STUCK) == (1, 2, 5, 15)
dog._PERIOD, dog._SOON, dog._LATE, dog._STUCK = 0.1, 0.3, 0.5, 0.8
node.handle.bridge.soon(dog._Check().again)  # the first check waits a second
"""
"""Shortens the waits of the watchdog."""


RELAY = """
inner = node.create_client(AddTwoInts, "add"{group})
node.create_service(AddTwoInts, "add", add)

def twice(request, response):
    print("begins", flush=True)
    {wait}
    response.sum = 2 * answer.sum
    return response

node.create_service(AddTwoInts, "twice", twice)
"""


CALL = "answer = inner.call(request)"
OWN = ", callback_group=MutuallyExclusiveCallbackGroup()"
POOL = """
executor = MultiThreadedExecutor(4)
executor.add_node(node)
client = node.create_client(AddTwoInts, "twice", callback_group=ReentrantCallbackGroup())
future = client.call_async(REQUEST)
executor.spin_until_future_complete(future, 3)
print(future.result())
executor.shutdown()
"""


def told(err):
    return [line for line in err.splitlines() if line.startswith("[taskrpc] ROS 2 would ")]
