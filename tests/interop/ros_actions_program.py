"""Prints what actions do, step by step; the output must be the same on the real rclpy and here.

The argument is `single` or `multi`, the kind of executor.
"""

import os
import re
import sys
import threading
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
from rclpy.qos import qos_profile_services_default
from rclpy.service_introspection import ServiceIntrospectionState
from test_msgs.action import Fibonacci
from unique_identifier_msgs.msg import UUID

PATIENCE = 20.0
STATUS = "UNKNOWN ACCEPTED EXECUTING CANCELING SUCCEEDED CANCELED ABORTED".split()
STAMPS = re.compile(r"sec=[1-9]\d*, nanosec=\d+")
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
        self.is_handed_over = threading.Event()
        """Set when `accepted` has ended, which is after the client has got its response."""
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
            result_timeout=int(PATIENCE),
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
        self.is_handed_over.set()

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
        self.is_handed_over.clear()
        future = self.client.send_goal_async(
            Fibonacci.Goal(order=order),
            feedback_callback=lambda message: heard.append(list(message.feedback.sequence)),
            goal_uuid=UUID(uuid=[self.number] * 16),
        )
        handle = self.wait(future)
        if handle.accepted:  # another thread may still be in `accepted`
            self.is_handed_over.wait(PATIENCE)
        say("response", handle.accepted, handle.stamp.sec > 0, bytes(handle.goal_id.uuid).hex())
        return handle, heard

    def finish(self, handle, heard=None):
        response = self.wait(handle.get_result_async())
        # The feedback and the status are messages, which may come after the result.
        self.spin_until(lambda: heard != [] and handle.status == response.status, 0.2)
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

    def expire(self):
        """Ask for the result of a goal until the server has forgotten the goal."""
        server = ActionServer(self.node, Fibonacci, "short", self.execute, result_timeout=1)
        client = ActionClient(self.node, Fibonacci, "short")
        client.wait_for_server(PATIENCE)
        goal, name = Fibonacci.Goal(order=SUCCEED), UUID(uuid=[98] * 16)
        handle = self.wait(client.send_goal_async(goal, goal_uuid=name))
        end = time.monotonic() + PATIENCE
        response = self.wait(handle.get_result_async())
        while response.status and time.monotonic() < end:
            self.executor.spin_once(0.1)
            response = self.wait(handle.get_result_async())
        say("result", STATUS[response.status], list(response.result.sequence))
        server.destroy()
        client.destroy()

    def introspect(self):
        """Say which introspection events the services of the action publish."""
        impl = Fibonacci.Impl
        kinds = {
            "send_goal": impl.SendGoalService,
            "cancel_goal": impl.CancelGoalService,
            "get_result": impl.GetResultService,
        }
        events = {name: [] for name in kinds}
        for name, kind in kinds.items():
            topic = f"/fibonacci/_action/{name}/_service_event"
            take, group = events[name].append, self.client.callback_group
            self.node.create_subscription(kind.Event, topic, take, 100, callback_group=group)
        for state in ("CONTENTS", "METADATA", "OFF"):
            say("-- introspection", state)
            for side in (self.server, self.client):
                side.configure_introspection(
                    self.node.get_clock(),
                    qos_profile_services_default,
                    getattr(ServiceIntrospectionState, state),
                )
            self.spin_until(lambda s=state: s == "OFF" or self.are_subscribed(events))
            handle, _ = self.send(WAIT)
            ended = handle.get_result_async()
            self.wait(handle.cancel_goal_async())
            self.handles[-1].execute()
            self.wait(ended)
            wanted = 0 if state == "OFF" else 4
            self.spin_until(lambda n=wanted: all(len(each) >= n for each in events.values()))
            for name, found in events.items():
                for event in sorted(found, key=lambda each: each.info.event_type):
                    self.say_event(name, event)
                gids = {bytes(event.info.client_gid) for event in found}
                say(name, len(found), len(gids))
                found.clear()

    def are_subscribed(self, events):
        topics = [f"/fibonacci/_action/{name}/_service_event" for name in events]
        # The client publishes, and the server does.
        return all(len(self.node.get_publishers_info_by_topic(topic)) == 2 for topic in topics)

    def spin_until(self, condition, longer=0.5):
        """Spin until a condition holds, and some seconds longer for what should not come."""
        end = time.monotonic() + PATIENCE
        while not condition() and time.monotonic() < end:
            self.executor.spin_once(0.05)
        end = time.monotonic() + longer
        while time.monotonic() < end:
            self.executor.spin_once(0.05)

    def say_event(self, name, event):
        info = event.info
        # Not the numbers of the calls: a client and a server of taskrpc count them separately.
        say(name, info.event_type, info.stamp.sec > 0, len(info.client_gid))
        for message in (*event.request, *event.response):
            values = [getattr(message, field) for field in message.get_fields_and_field_types()]
            say(type(message).__name__, " ".join(STAMPS.sub("T", str(each)) for each in values))

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
        self.introspect()
        say("-- expired")
        self.expire()
        say([STATUS[handle.status] for handle in self.handles])
        self.server.destroy()
        self.client.destroy()


rclpy.init()
World(sys.argv[1]).run()
sys.stdout.flush()
sys.stderr.flush()
os._exit(0)  # the real rclpy sometimes crashes at its end
