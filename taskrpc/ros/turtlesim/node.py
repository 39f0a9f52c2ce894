"""`taskrpc run turtlesim turtlesim_node`: the node, its services, topics and actions.

One thread runs everything: a timer moves the turtles, and between callbacks the view draws.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, TypeAlias

import rclpy
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor, ParameterEvent
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.service import Service
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Empty

from taskrpc.errors import NameInUse, TaskRpcError
from taskrpc.ros.turtlesim.canvas import Color as Rgb
from taskrpc.ros.turtlesim.drawing import views
from taskrpc.ros.turtlesim.teleop import TeleopTurtle
from taskrpc.ros.turtlesim.types import (
    Color,
    Kill,
    Pose,
    RotateAbsolute,
    SetPen,
    Spawn,
    TeleportAbsolute,
    TeleportRelative,
)
from taskrpc.ros.turtlesim.world import CENTRE, STEP, Moved, Rotation, Turtle, World

_Goal: TypeAlias = ServerGoalHandle[
    RotateAbsolute.Goal, RotateAbsolute.Result, RotateAbsolute.Feedback
]

_BACKGROUND = {"r": ("Red", 69), "g": ("Green", 86), "b": ("Blue", 255)}
_QUEUE = 7
"""Messages that a topic keeps, as in ROS."""


class Turtlesim(Node):
    """The node `turtlesim` and its world."""

    def __init__(self, **options: Any) -> None:
        super().__init__("turtlesim", **options)
        self.world = World()
        self._rotations: dict[str, _Rotations] = {}
        self._entities: dict[str, _Entities] = {}
        self._declare_parameters()
        self.create_service(Empty, "clear", self._clear)
        self.create_service(Empty, "reset", self._reset)
        self.create_service(Spawn, "spawn", self._spawn)
        self.create_service(Kill, "kill", self._kill)
        # The view reads the colors for each picture, but ROS's documentation lists this topic.
        self.create_subscription(ParameterEvent, "/parameter_events", lambda _: None, _QUEUE)
        name = self.get_fully_qualified_name()
        self.get_logger().info(f"Starting turtlesim with node name {name}")
        self._add("", CENTRE, CENTRE, 0.0)
        self.create_timer(STEP, self._step)

    @property
    def background(self) -> Rgb:
        """The color of the paper, from the parameters."""
        red, green, blue = (self.get_parameter(f"background_{one}").value for one in "rgb")
        return red, green, blue

    def _declare_parameters(self) -> None:
        for letter, (color, default) in _BACKGROUND.items():
            descriptor = ParameterDescriptor(
                description=f"{color} channel of the background color",
                integer_range=[IntegerRange(from_value=0, to_value=255, step=1)],
            )
            self.declare_parameter(f"background_{letter}", default, descriptor)
        descriptor = ParameterDescriptor(description="If true, then turtles will be holonomic")
        self.declare_parameter("holonomic", False, descriptor)

    def now(self) -> float:
        """The time of the node's clock [s]."""
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def command(self, turtle: Turtle, twist: Twist) -> None:
        """Move a turtle with these velocities."""
        sideways = twist.linear.y if self.get_parameter("holonomic").value else 0.0
        turtle.command(twist.linear.x, sideways, twist.angular.z, self.now())

    def _add(self, name: str, x: float, y: float, theta: float) -> str:
        name = name or self.world.free_name()
        turtle = self.world.spawn(name, x, y, theta)
        try:
            self._entities[name] = _Entities(self, turtle)
        except BaseException:
            del self.world.turtles[name]
            raise
        where = f"x=[{x:.6f}], y=[{y:.6f}], theta=[{theta:.6f}]"
        self.get_logger().info(f"Spawning turtle [{name}] at {where}")
        return name

    def _remove(self, name: str) -> None:
        del self.world.turtles[name]
        self._entities.pop(name).destroy()

    def _spawn(self, request: Spawn.Request, response: Spawn.Response) -> Spawn.Response:
        if request.name in self.world.turtles:
            self.get_logger().error(f"A turtle named [{request.name}] already exists")
        else:
            try:
                response.name = self._add(request.name, request.x, request.y, request.theta)
            except (NameValidationException, NameInUse) as error:
                problem = " ".join(str(error).split())
                self.get_logger().error(f"A turtle cannot be named [{request.name}]: {problem}")
        return response

    def _kill(self, request: Kill.Request, response: Kill.Response) -> Kill.Response:
        if request.name in self.world.turtles:
            self._remove(request.name)
        else:
            problem = f"Tried to kill turtle [{request.name}], which does not exist"
            self.get_logger().error(problem)
        return response

    def _clear(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        self.get_logger().info("Clearing turtlesim.")
        self.world.canvas.clear()
        return response

    def _reset(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        self.get_logger().info("Resetting turtlesim.")
        for name in list(self.world.turtles):
            self._remove(name)
        self.world.reset()
        self._add("", CENTRE, CENTRE, 0.0)
        return response

    def _step(self) -> None:
        for entities in self._entities.values():
            entities.rotations.stop_if_cancelled()
        for name, moved in self.world.step(self.now()).items():
            if moved.hit is not None:
                where = "x={:f}, y={:f}".format(*moved.hit)
                self.get_logger().warning(f"Oh no! I hit the wall! (Clamping from [{where}])")
            self._entities[name].publish(moved)


class _Entities:
    """The topics, services and the action of one turtle."""

    def __init__(self, node: Turtlesim, turtle: Turtle) -> None:
        self._turtle = turtle
        at = partial("{}/{}".format, turtle.name)
        with ExitStack() as made:  # a name that is refused leaves nothing behind
            self._poses = node.create_publisher(Pose, at("pose"), _QUEUE)
            made.callback(node.destroy_publisher, self._poses)
            self._colors = node.create_publisher(Color, at("color_sensor"), _QUEUE)
            made.callback(node.destroy_publisher, self._colors)
            move = partial(node.command, turtle)
            commands = node.create_subscription(Twist, at("cmd_vel"), move, _QUEUE)
            made.callback(node.destroy_subscription, commands)

            def keep(service: Service[Any, Any]) -> None:
                made.callback(node.destroy_service, service)

            keep(node.create_service(SetPen, at("set_pen"), self._set_pen))
            keep(node.create_service(TeleportRelative, at("teleport_relative"), self._shift))
            keep(node.create_service(TeleportAbsolute, at("teleport_absolute"), self._teleport))
            self.rotations = _Rotations(node, turtle)
            made.callback(self.rotations.destroy)
            self._made = made.pop_all()

    def publish(self, moved: Moved) -> None:
        """Publish the state after a step."""
        turtle = self._turtle
        pose = Pose(x=turtle.x, y=turtle.y, theta=turtle.theta)
        pose.linear_velocity, pose.angular_velocity = turtle.speed, turtle.angular
        self._poses.publish(pose)
        red, green, blue = turtle.color
        self._colors.publish(Color(r=red, g=green, b=blue))
        if moved.rotation is not None:
            self.rotations.report(moved.rotation)

    def destroy(self) -> None:
        """Remove them from the node."""
        self._made.close()

    def _set_pen(self, request: SetPen.Request, response: SetPen.Response) -> SetPen.Response:
        color = (request.r, request.g, request.b)
        self._turtle.set_pen(color, request.width, bool(request.off))
        return response

    def _shift(
        self, request: TeleportRelative.Request, response: TeleportRelative.Response
    ) -> TeleportRelative.Response:
        self._turtle.teleport_relative(request.linear, request.angular)
        return response

    def _teleport(
        self, request: TeleportAbsolute.Request, response: TeleportAbsolute.Response
    ) -> TeleportAbsolute.Response:
        self._turtle.teleport_absolute(request.x, request.y, request.theta)
        return response


class _Rotations:
    """The action `rotate_absolute` of one turtle: a new goal aborts the one before."""

    def __init__(self, node: Turtlesim, turtle: Turtle) -> None:
        self._node, self._turtle = node, turtle
        self._goal: _Goal | None = None
        self._ended: Future[RotateAbsolute.Result] = Future()
        self._result = RotateAbsolute.Result()
        self._server = ActionServer(
            node,
            RotateAbsolute,
            f"{turtle.name}/rotate_absolute",
            self._execute,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    async def _execute(self, goal: _Goal) -> RotateAbsolute.Result:
        if self._goal is not None:
            problem = "Rotation goal received before a previous goal finished."
            self._node.get_logger().warning(f"{problem} Aborting previous goal")
            self._end(self._goal.abort)
        self._goal, self._ended = goal, Future()
        self._result = RotateAbsolute.Result()
        self._turtle.rotate_to(goal.request.theta)
        return await self._ended or RotateAbsolute.Result()

    def stop_if_cancelled(self) -> None:
        """End the goal if its client has cancelled it."""
        if self._goal is not None and self._goal.is_cancel_requested:
            self._node.get_logger().info("Rotation goal canceled")
            self._turtle.stop_rotation()
            self._end(self._goal.canceled)

    def report(self, rotation: Rotation) -> None:
        """Send the progress of the goal to its client."""
        if self._goal is None:
            return
        self._result.delta = rotation.delta
        self._goal.publish_feedback(RotateAbsolute.Feedback(remaining=rotation.remaining))
        if rotation.done:
            self._node.get_logger().info("Rotation goal completed successfully")
            self._end(self._goal.succeed)

    def destroy(self) -> None:
        """Abort the goal and remove the action."""
        if self._goal is not None:
            self._end(self._goal.abort)
        self._server.destroy()

    def _end(self, change_state: Callable[[], None]) -> None:
        change_state()
        self._ended.set_result(self._result)
        self._goal = None


def main(args: Sequence[str] | None = None) -> int:
    """Show turtles until Ctrl-C, or until the user closes the window."""
    arguments = list(sys.argv if args is None else args)
    options = _options(remove_ros_args(arguments)[1:])
    try:
        with rclpy.init(args=arguments):
            _show(options)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0


def _show(options: argparse.Namespace) -> None:
    with ExitStack() as stack:
        try:  # first, so that the node's log lines are below the picture
            view = stack.enter_context(views.opened(options.view, options.port))
        except TaskRpcError as error:
            raise SystemExit(f"turtlesim_node: {error}") from None
        _spin(view)


def _spin(view: views.PacedView) -> None:
    """Run the node until the user closes the view."""
    executor = SingleThreadedExecutor()
    node = Turtlesim()
    executor.add_node(node)
    view.title = node.get_fully_qualified_name()
    teleop: TeleopTurtle | None = None
    while view.draw(node.world, node.background):
        for key in view.pressed_keys():
            if teleop is None:  # not earlier, so that the graph shows it only if it is used
                settings = {"namespace": node.get_namespace(), "use_global_arguments": False}
                teleop = TeleopTurtle(**settings)
                executor.add_node(teleop)
            teleop.press(key)
        executor.spin_once(timeout_sec=STEP)


def _options(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser("turtlesim_node", description="Shows turtles in a window.")
    what = "where to draw; without this option a window, else a web page, else the terminal"
    parser.add_argument("--view", choices=views.NAMES, default="auto", help=what)
    port = "the port of the web page; 0 means any free port"
    parser.add_argument("--port", type=_port, help=f"{port}; default: 8643, or any free port")
    return parser.parse_args(arguments)


def _port(text: str) -> int:
    if text.isascii() and text.isdecimal() and int(text) < 65536:
        return int(text)
    raise argparse.ArgumentTypeError(f"expected a port from 0 to 65535, got {text!r}")
