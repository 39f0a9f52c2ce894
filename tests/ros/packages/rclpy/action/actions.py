"""An action server and an action client on two nodes, and an executor that spins both."""

from __future__ import annotations

import contextlib

import srvgen
from taskrpc.ros.packages.rclpy.action import ActionClient, ActionServer
from tests.ros.packages.rclpy.living import living

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
GoalStatus = srvgen.load("action_msgs/msg/GoalStatus")
UUID = srvgen.load("unique_identifier_msgs/msg/UUID")


def order(number):
    return Fibonacci.Goal(order=number)


def result(*numbers):
    return Fibonacci.Result(sequence=numbers)


def succeed(goal):
    """Return the order of the goal."""
    goal.succeed()
    return result(goal.request.order)


def ended(response):
    """The status and the sequence of a result."""
    return response.status, list(response.result.sequence)


class Pair:
    """The two sides of the action `/fibonacci`, in one world."""

    def __init__(self, world, execute, settings):
        self.world = world
        self.served = world.node("served")
        self.calling = world.node("calling")
        self.server = ActionServer(self.served, Fibonacci, "fibonacci", execute, **settings)
        self.client = ActionClient(self.calling, Fibonacci, "fibonacci")
        assert self.client.wait_for_server(10)

    def send(self, goal, **options):
        return self.world.answer(self.client.send_goal_async(goal, **options))

    def finish(self, goal, **options):
        """Send a goal and return its status and its sequence."""
        handle = self.send(goal, **options)
        return ended(self.world.answer(handle.get_result_async()))

    def cancel(self, handle):
        """Cancel a goal and return how many goals are being cancelled."""
        return len(self.world.answer(handle.cancel_goal_async()).goals_canceling)


@contextlib.contextmanager
def action(execute=succeed, **settings):
    """Settings are those of the server."""
    with living() as world:
        yield Pair(world, execute, settings)
