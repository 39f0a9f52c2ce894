"""Programs with actions, as courses write them, run unchanged; so do their command lines."""

import re
import subprocess
import sys

import pytest

from tests.ros.packages.rclpy.programs.running import PATIENCE

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

SERVER = """
import time

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node

from example_interfaces.action import Fibonacci


class Server(Node):
    def __init__(self):
        super().__init__("fibonacci_server")
        self.server = ActionServer(
            self, Fibonacci, "fibonacci", self.execute,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=self.accept, cancel_callback=self.cancel)
        self.get_logger().info("ready")

    def accept(self, goal):
        self.get_logger().info(f"goal of order {goal.order}")
        return GoalResponse.ACCEPT if goal.order < 50 else GoalResponse.REJECT

    def cancel(self, goal_handle):
        self.get_logger().info("cancel")
        return CancelResponse.ACCEPT

    async def execute(self, goal_handle):
        message = Fibonacci.Feedback()
        message.sequence = [0, 1]
        while len(message.sequence) <= goal_handle.request.order:
            if goal_handle.is_cancel_requested:
                goal_handle.canceled()
                self.get_logger().info("canceled")
                return Fibonacci.Result()
            message.sequence.append(message.sequence[-1] + message.sequence[-2])
            goal_handle.publish_feedback(message)
            time.sleep(0.1)
        goal_handle.succeed()
        result = Fibonacci.Result()
        result.sequence = message.sequence
        return result


try:
    with rclpy.init():
        rclpy.spin(Server(), executor=MultiThreadedExecutor())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""

CLIENT = """
import sys

import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node

from action_msgs.msg import GoalStatus
from example_interfaces.action import Fibonacci


class Client(Node):
    def __init__(self):
        super().__init__("fibonacci_client")
        self.client = ActionClient(self, Fibonacci, "fibonacci")
        self.number = 0

    def send(self, order, feedback_number):
        self.feedback_number = feedback_number
        self.client.wait_for_server()
        future = self.client.send_goal_async(Fibonacci.Goal(order=order), self.feedback)
        future.add_done_callback(self.answered)

    def answered(self, future):
        self.goal_handle = future.result()
        if not self.goal_handle.accepted:
            print("rejected")
            rclpy.shutdown()
            return
        self.goal_handle.get_result_async().add_done_callback(self.ended)

    def feedback(self, message):
        self.number += 1
        if self.number == self.feedback_number:
            self.goal_handle.cancel_goal_async().add_done_callback(
                lambda future: print("canceling", len(future.result().goals_canceling)))

    def ended(self, future):
        response = future.result()
        if response.status == GoalStatus.STATUS_SUCCEEDED:
            print(self.number, list(response.result.sequence))
        else:
            print("status", response.status)
        rclpy.shutdown()


rclpy.init(args=sys.argv)
node = Client()
node.send(int(sys.argv[1]), int(sys.argv[2]))
rclpy.spin(node)
"""

QUEUE = """
import collections
import rclpy
from rclpy.action import ActionServer
from rclpy.node import Node
from example_interfaces.action import Fibonacci

rclpy.init()
node = Node("queueing")
waiting = collections.deque()

def accepted(goal_handle):
    waiting.append(goal_handle)
    if len(waiting) == 3:
        while waiting:
            waiting.pop().execute(lambda goal: executed(goal))

def executed(goal_handle):
    print("executing", goal_handle.request.order, flush=True)
    goal_handle.succeed()
    return Fibonacci.Result(sequence=[goal_handle.request.order])

server = ActionServer(node, Fibonacci, "fibonacci", print, handle_accepted_callback=accepted)

from rclpy.action import ActionClient
client = ActionClient(node, Fibonacci, "fibonacci")
client.wait_for_server()
futures = [client.send_goal_async(Fibonacci.Goal(order=n)) for n in range(3)]
for future in futures:
    rclpy.spin_until_future_complete(node, future)
for future in futures:
    result = future.result().get_result_async()
    rclpy.spin_until_future_complete(node, result)
    print(list(result.result().result.sequence))
"""

TUTORIAL = """
import rclpy
from rclpy.action import ActionServer
from rclpy.node import Node
from lesson_interfaces.action import Countdown


class CountdownServer(Node):
    def __init__(self):
        super().__init__("countdown_server")
        self._action_server = ActionServer(self, Countdown, "countdown", self.execute_callback)

    def execute_callback(self, goal_handle):
        self.get_logger().info("Executing goal...")
        return Countdown.Result()


def main(args=None):
    rclpy.init(args=args)
    rclpy.spin(CountdownServer())


if __name__ == "__main__":
    main()
"""


def commanded(*arguments):
    """Run `taskrpc …`: its exit status and its output."""
    command = [sys.executable, "-m", "taskrpc", *arguments]
    ended = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE
    )
    return ended.returncode, ended.stdout


def test_goals_succeed_are_cancelled_and_are_rejected(ros, run):
    server = ros(SERVER, name="server.py")
    server.wait_for("ready")
    assert run(CLIENT, 4, 0, name="client.py") == (0, "3 [0, 1, 1, 2, 3]\n", "")
    assert run(CLIENT, 40, 2, name="client.py") == (0, "canceling 1\nstatus 5\n", "")
    assert run(CLIENT, 50, 0, name="client.py") == (0, "rejected\n", "")
    assert server.interrupt() == 0
    lines = ["ready", "goal of order 4", "goal of order 40", "cancel", "canceled"]
    lines.append("goal of order 50")
    assert server.err == "".join(f"[INFO] [T] [fibonacci_server]: {line}\n" for line in lines)


def test_a_program_executes_deferred_goals_in_its_own_order(run):
    code, out, err = run(QUEUE)
    assert (code, err) == (0, "")
    executed = [line for line in out.splitlines() if "executing" in line]
    assert sorted(executed) == ["executing 0", "executing 1", "executing 2"]
    assert [line for line in out.splitlines() if "[" in line] == ["[0]", "[1]", "[2]"]


def test_an_action_of_a_package_of_the_workspace(ros, tmp_path, monkeypatch):
    package = tmp_path / "src" / "lesson_interfaces"
    (package / "action").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>lesson_interfaces</name></package>")
    definition = "int32 seconds\n---\nbool landed\n---\nint32 left\n"
    (package / "action" / "Countdown.action").write_text(definition)
    monkeypatch.chdir(tmp_path)
    server = ros(TUTORIAL, name="server.py")
    name = "lesson_interfaces/action/Countdown"
    code, out = commanded("action", "send_goal", "countdown", name, "{seconds: 10}")
    assert code == 0  # the command worked; the callback forgot goal_handle.succeed()
    assert re.fullmatch(
        r"Waiting for an action server to become available\.\.\.\n"
        r"Sending goal:\n     seconds: 10\n\n"
        r"Goal accepted with ID: [0-9a-f]{32}\n\n"
        r"Result:\n    landed: false\n\n"
        r"Goal finished with status: ABORTED\n",
        out,
    )
    server.wait_for("Goal state not set, assuming aborted. Goal ID: [")
    assert commanded("action", "info", "-t", "/countdown") == (
        0,
        "Action: /countdown\nAction clients: 0\nAction servers: 1\n"
        f"    /countdown_server [{name}]\n",
    )
    code, out = commanded("interface", "show", name)
    assert (code, out) == (0, definition)
