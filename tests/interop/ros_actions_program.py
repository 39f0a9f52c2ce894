"""Prints what actions do, step by step; the output must be the same on the real rclpy and here.

The argument is `single` or `multi`, the kind of executor.
"""

import os
import sys
import time

import rclpy
from action_msgs.srv import CancelGoal
from rclpy.action import (
    ActionClient,
    ActionServer,
    CancelResponse,
    GoalResponse,
    get_action_client_names_and_types_by_node,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from test_msgs.action import Fibonacci
from unique_identifier_msgs.msg import UUID

PATIENCE = 20.0
STATUS = "UNKNOWN ACCEPTED EXECUTING CANCELING SUCCEEDED CANCELED ABORTED".split()
SUCCEED, ABORT, RAISE, UNDECIDED, WAIT, INVALID, OTHER = range(1, 8)


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")  # one string: several threads print


def attempt(what, action):
    """Say which exception an action raises; only the first sentence of its text."""
    try:
        action()
    except Exception as error:
        text = str(error).partition(", at ")[0] if isinstance(error, RuntimeError) else ""
        say(what, "raises", type(error).__name__, text)
    else:
        say(what, "is accepted")


class World:
    def __init__(self, kind):
        self.node = Node("world")
        multi = kind == "multi"
        self.executor = MultiThreadedExecutor(4) if multi else SingleThreadedExecutor()
        self.executor.add_node(self.node)
        group = ReentrantCallbackGroup()
        self.handles = []
        self.number = 0
        self.cancels = CancelResponse.ACCEPT
        self.server = ActionServer(
            self.node,
            Fibonacci,
            "fibonacci",
            self.execute,
            callback_group=group,
            goal_callback=self.accept,
            handle_accepted_callback=self.accepted,
            cancel_callback=self.cancel,
            result_timeout=1,
        )
        self.client = ActionClient(self.node, Fibonacci, "fibonacci", callback_group=group)
        say("ready", self.client.wait_for_server(PATIENCE), self.client.server_is_ready())

    # The server

    def accept(self, goal):
        say("asked to accept", goal.order)
        return GoalResponse.REJECT if goal.order == 0 else GoalResponse.ACCEPT

    def accepted(self, handle):
        say("accepted", handle.request.order, STATUS[handle.status], handle.is_active)
        self.handles.append(handle)
        if handle.request.order != WAIT:
            handle.execute()

    def cancel(self, handle):
        say("asked to cancel", handle.request.order, STATUS[handle.status])
        return self.cancels

    async def execute(self, handle):
        order = handle.request.order
        say("executing", order, STATUS[handle.status], handle.is_cancel_requested)
        feedback = Fibonacci.Feedback(sequence=[order])
        handle.publish_feedback(feedback)
        if order == RAISE:
            raise ValueError("the wheel is blocked")
        if order == INVALID:
            attempt("canceled", handle.canceled)
            attempt("execute", handle.execute)
            attempt("feedback of a wrong type", lambda: handle.publish_feedback("text"))
            handle.succeed()
            for event in ("succeed", "abort", "canceled"):
                attempt(event, getattr(handle, event))
            say("ended", STATUS[handle.status], handle.is_active)
        if order == OTHER:
            handle.succeed()
            return feedback
        if order == SUCCEED:
            handle.succeed()
        elif order == ABORT:
            handle.abort()
        elif order == WAIT:
            handle.canceled()
        return Fibonacci.Result(sequence=[order, order])

    # The client

    def wait(self, future):
        self.executor.spin_until_future_complete(future, PATIENCE)
        return future.result()

    def send(self, order):
        self.number += 1
        heard = []
        future = self.client.send_goal_async(
            Fibonacci.Goal(order=order),
            feedback_callback=lambda message: heard.append(list(message.feedback.sequence)),
            goal_uuid=UUID(uuid=[self.number] * 16),
        )
        handle = self.wait(future)
        say("response", handle.accepted, handle.stamp.sec > 0, bytes(handle.goal_id.uuid).hex())
        return handle, heard

    def finish(self, handle, heard=()):
        response = self.wait(handle.get_result_async())
        for _ in range(5):
            self.executor.spin_once(0.05)
        say("result", STATUS[response.status], list(response.result.sequence), heard)
        say("handle", STATUS[handle.status])

    def cancel_request(self, goal_id=None, stamp=None):
        request = CancelGoal.Request()
        if goal_id is not None:
            request.goal_info.goal_id = goal_id
        if stamp is not None:
            request.goal_info.stamp = stamp
        client = self.node.create_client(CancelGoal, "/fibonacci/_action/cancel_goal")
        client.wait_for_service(PATIENCE)
        response = self.wait(client.call_async(request))
        goals = [bytes(each.goal_id.uuid).hex()[:2] for each in response.goals_canceling]
        say("cancel response", response.return_code, sorted(goals))
        self.node.destroy_client(client)

    def run(self):
        node = self.node
        say(get_action_names_and_types(node))
        say(get_action_server_names_and_types_by_node(node, "world", "/"))
        say(get_action_client_names_and_types_by_node(node, "world", "/"))
        for order in (SUCCEED, ABORT, RAISE, UNDECIDED, INVALID, OTHER):
            say(f"-- goal {order}")
            self.finish(*self.send(order))
        say("-- rejected, sent again, of a wrong type")
        rejected, _ = self.send(0)
        say(rejected.accepted, STATUS[rejected.status])
        self.number -= 2
        self.send(SUCCEED)
        self.number += 1
        attempt("a goal of a wrong type", lambda: self.client.send_goal_async("five"))
        say("-- cancelled")
        waiting, _ = self.send(WAIT)
        self.cancels = CancelResponse.REJECT
        self.cancel_request(waiting.goal_id)
        self.cancels = CancelResponse.ACCEPT
        say(len(self.wait(waiting.cancel_goal_async()).goals_canceling))
        say(STATUS[self.handles[-1].status], self.handles[-1].is_cancel_requested)
        self.handles[-1].execute()
        self.finish(waiting)
        self.cancel_request(waiting.goal_id)
        self.cancel_request(UUID(uuid=[99] * 16))
        say("-- cancelled by time, and all")
        first, _ = self.send(WAIT)
        time.sleep(0.01)
        between = node.get_clock().now().to_msg()
        time.sleep(0.01)
        second, _ = self.send(WAIT)
        self.cancel_request(stamp=between)
        self.cancel_request()
        for handle in self.handles[-2:]:
            handle.execute()
        for handle in (first, second):
            self.finish(handle)
        say("-- expired")
        end = time.monotonic() + 2
        while time.monotonic() < end:
            self.executor.spin_once(0.1)
        self.finish(second)
        say([STATUS[handle.status] for handle in self.handles])
        self.server.destroy()
        self.client.destroy()


rclpy.init()
World(sys.argv[1]).run()
sys.stdout.flush()
sys.stderr.flush()
os._exit(0)  # the real rclpy sometimes crashes at its end
