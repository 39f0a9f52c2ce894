"""`taskrpc run turtlesim turtle_teleop_key`: drives a turtle with the keyboard."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import closing, suppress
from typing import Any

import rclpy
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import ParameterEvent
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from taskrpc.ros.turtlesim.keyboard import keys
from taskrpc.ros.turtlesim.keys import CANCEL, DIRECTIONS, HEADINGS, QUIT
from taskrpc.ros.turtlesim.types import RotateAbsolute

_HELP = """\
Reading from keyboard
---------------------------
Use arrow keys to move the turtle.
Use g|b|v|c|d|e|r|t keys to rotate to absolute orientations. 'f' to cancel a rotation.
'q' to quit."""


class TeleopTurtle(Node):
    """The node `teleop_turtle`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("teleop_turtle", **options)
        self.declare_parameter("scale_angular", 2.0)
        self.declare_parameter("scale_linear", 2.0)
        # Nothing reads it, but ROS's documentation lists this topic of the node.
        self.create_subscription(ParameterEvent, "/parameter_events", lambda _: None, 10)
        self._velocities = self.create_publisher(Twist, "turtle1/cmd_vel", 1)
        self._rotations = ActionClient(self, RotateAbsolute, "turtle1/rotate_absolute")
        self._goal: Any = None
        """The handle of the last goal that the server accepted."""

    def press(self, key: str) -> None:
        """Do what a key means."""
        if key in DIRECTIONS:
            self._move(*DIRECTIONS[key])
        elif key in HEADINGS:
            goal = RotateAbsolute.Goal(theta=HEADINGS[key])
            self._rotations.send_goal_async(goal).add_done_callback(self._keep)
        elif key == CANCEL and self._goal is not None:
            self._goal.cancel_goal_async()

    def _move(self, linear: float, angular: float) -> None:
        twist = Twist()
        twist.linear.x = linear * self.get_parameter("scale_linear").value
        twist.angular.z = angular * self.get_parameter("scale_angular").value
        self._velocities.publish(twist)

    def _keep(self, response: Any) -> None:
        self._goal = response.result()


def main(args: Sequence[str] | None = None) -> int:
    """Read keys until `q` or Ctrl-C."""
    try:
        with rclpy.init(args=args):
            node = TeleopTurtle()
            spinning = threading.Thread(target=_spin, args=[node], daemon=True)
            spinning.start()
            print(_HELP, flush=True)
            with closing(keys()) as pressed:  # restores the terminal
                for key in pressed:
                    if key == QUIT:
                        break
                    node.press(key)
        spinning.join()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0


def _spin(node: Node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with suppress(ExternalShutdownException):
        executor.spin()
