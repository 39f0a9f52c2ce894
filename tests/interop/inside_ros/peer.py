"""Plain ROS programs for the tests: they use rclpy only, and nothing of taskrpc.

`python peer.py VERB …` ends after 60 s at the latest, because a ROS program may hang at SIGTERM.
"""

import contextlib
import os
import sys
import threading
import time

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from test_msgs.action import Fibonacci


def serve(node):
    """Serve /ros_hello, /ros_slow (3 s) and /ros_leave (shuts down instead of a response)."""

    def hello(_, response):
        response.success, response.message = True, "hello from ROS"
        return response

    def slow(_, response):
        time.sleep(3)
        return response

    def leave(_, response):
        raise ExternalShutdownException

    def invert(request, response):
        response.success, response.message = not request.data, "inverted"
        return response

    node.create_service(Trigger, "/ros_hello", hello)
    node.create_service(Trigger, "/ros_slow", slow)
    node.create_service(Trigger, "/ros_leave", leave)
    node.create_service(SetBool, "/ros_invert", invert)
    say("ready")
    rclpy.spin(node)


def call(node, name, count):
    """Call a Trigger service `count` times at once; print the responses and the seconds."""
    client = node.create_client(Trigger, name)
    if not client.wait_for_service(10):
        say("no server")
        return
    began = time.monotonic()
    futures = [client.call_async(Trigger.Request()) for _ in range(int(count))]
    for future in futures:
        rclpy.spin_until_future_complete(node, future, timeout_sec=10)
        response = future.result()
        say(f"{response.success} {response.message}" if response else "no response")
    say(f"seconds {time.monotonic() - began:.2f}")


def invert(node, name):
    """Call a SetBool service with true and false."""
    client = node.create_client(SetBool, name)
    client.wait_for_service(10)
    for data in (True, False):
        future = client.call_async(SetBool.Request(data=data))
        rclpy.spin_until_future_complete(node, future, timeout_sec=10)
        say(f"{data} {future.result()}")


def talk(node, topic, quality):
    """Publish numbers until the end; `quality` is volatile, latched or best_effort."""
    qos = QoSProfile(depth=10)
    if quality == "latched":
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    if quality == "best_effort":
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
    what = "number" if quality == "volatile" else quality
    publisher = node.create_publisher(String, topic, qos)
    publisher.publish(String(data="first"))
    say("ready")
    for number in range(500):
        time.sleep(0.1)
        if quality != "latched":
            publisher.publish(String(data=f"{what} {number}"))


def listen(node, topic, count):
    """Print so many messages."""
    got = []
    node.create_subscription(String, topic, lambda message: got.append(message.data), 10)
    say("ready")
    while len(got) < int(count):
        rclpy.spin_once(node, timeout_sec=1)
    for each in got:
        say(each)


def serve_action(node):
    """Serve /fibonacci: reject the order 0, abort the order 1, cancel when a client asks."""

    def execute(goal):
        sequence = [0, 1]
        for _ in range(goal.request.order):
            if goal.is_cancel_requested:
                goal.canceled()
                return Fibonacci.Result(sequence=sequence)
            sequence.append(sequence[-1] + sequence[-2])
            goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
            time.sleep(0.1)
        if goal.request.order == 1:
            goal.abort()
        else:
            goal.succeed()
        return Fibonacci.Result(sequence=sequence)

    ActionServer(
        node,
        Fibonacci,
        "/fibonacci",
        execute,
        goal_callback=lambda goal: GoalResponse.ACCEPT if goal.order else GoalResponse.REJECT,
        cancel_callback=lambda goal: CancelResponse.ACCEPT,
    )
    say("ready")
    rclpy.spin(node, MultiThreadedExecutor())


def act(node, order, cancel=""):
    """Send a goal to /fibonacci; print its feedback and its end."""
    client = ActionClient(node, Fibonacci, "/fibonacci")
    if not client.wait_for_server(10):
        say("no server")
        return
    heard = []
    sent = client.send_goal_async(
        Fibonacci.Goal(order=int(order)), lambda message: heard.append(message.feedback.sequence)
    )
    rclpy.spin_until_future_complete(node, sent, timeout_sec=10)
    if not (handle := sent.result()).accepted:
        say("rejected")
        return
    if cancel:
        while not heard:
            rclpy.spin_once(node, timeout_sec=1)
        future = handle.cancel_goal_async()
        rclpy.spin_until_future_complete(node, future, timeout_sec=10)
        say("canceling", len(future.result().goals_canceling))
    future = handle.get_result_async()
    rclpy.spin_until_future_complete(node, future, timeout_sec=20)
    say("status", future.result().status, "sequence", *future.result().result.sequence)
    say("feedback", *[len(each) for each in heard])


def graph(node, *wanted):
    """Print the nodes and services, once the nodes `wanted` are there."""
    end = time.monotonic() + 10
    while not {*wanted} <= {*node.get_node_names()} and time.monotonic() < end:
        time.sleep(0.1)
    time.sleep(0.5)
    say("nodes", *sorted(node.get_node_names()))
    for name, types in node.get_service_names_and_types():
        say("service", name, *types)
    for name, types in node.get_topic_names_and_types():
        say("topic", name, *types)


def say(*words):
    """Print a line at once."""
    print(*words, flush=True)


def main():
    """Run one verb, 60 s at most."""
    end = threading.Timer(60, os._exit, [9])
    end.daemon = True
    end.start()
    verb, *arguments = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node(f"ros_{verb}")
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        globals()[verb](node, *arguments)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
