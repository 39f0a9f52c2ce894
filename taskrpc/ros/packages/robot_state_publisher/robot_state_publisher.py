"""The node `robot_state_publisher`: joint states in, transforms and the robot description out."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

import rclpy
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.time import Time
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

from .kinematics import Pace, Placed, fixed_frames, moving_frames
from .urdf import Robot, UrdfError, parse

_FREQUENCY = "publish_frequency must be between 0 (exclusive) and 1000"


class RobotStatePublisher(Node):
    """Publishes the frames of a robot.

    Args:
        description: the robot description, if the parameter `robot_description` is not set.

    Raises:
        ValueError: a parameter or the robot description is not valid.
    """

    def __init__(self, description: str = "") -> None:
        super().__init__("robot_state_publisher")
        text = str(self.declare_parameter("robot_description", description).value)
        if not text:
            raise ValueError("robot_description parameter must not be empty")
        frequency = float(self.declare_parameter("publish_frequency", 20.0).value)
        if not _is_frequency(frequency):
            raise ValueError(f"{_FREQUENCY}, got {frequency:g}")
        self._prefix = str(self.declare_parameter("frame_prefix", "").value)
        self._ignores_stamps = bool(self.declare_parameter("ignore_timestamp", False).value)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._descriptions = self.create_publisher(String, "robot_description", latched)
        self._moving = TransformBroadcaster(self)
        self._static = StaticTransformBroadcaster(self)
        self._pace = Pace(frequency)
        self._use(text, parse(text))
        self.add_on_set_parameters_callback(_checked)
        self.add_post_set_parameters_callback(self._changed)
        self.create_subscription(JointState, "joint_states", self._take, qos_profile_sensor_data)

    def _use(self, text: str, robot: Robot) -> None:
        self._robot = robot
        self._descriptions.publish(String(data=text))
        self.get_logger().info("Robot initialized")
        stamp = self.get_clock().now().to_msg()
        if fixed := self._messages(fixed_frames(robot), stamp):
            self._static.sendTransform(fixed)

    def _take(self, state: Any) -> None:
        names, positions = list(state.name), list(state.position)
        if len(names) != len(positions):
            self._refuse(names, positions)
            return
        if self._pace.went_back(self.get_clock().now().nanoseconds):
            self.get_logger().warning("Moved backwards in time, re-publishing joint transforms!")
        stamp = Time.from_msg(state.header.stamp).nanoseconds
        if not self._ignores_stamps and not self._pace.is_due(names, stamp):
            return
        # Of several positions of one joint, ROS uses the first.
        known = dict(zip(reversed(names), reversed(positions), strict=True))
        frames = moving_frames(self._robot, known)
        self._moving.sendTransform(self._messages(frames, state.header.stamp))
        self._pace.used(names, stamp)

    def _refuse(self, names: list[str], positions: list[float]) -> None:
        if positions:
            problem = "Robot state publisher ignored an invalid JointState message"
            counts = f"{len(names)} names, {len(positions)} positions"
            self.get_logger().error(f"{problem}: {counts}")
        else:
            self.get_logger().warning(
                "Robot state publisher ignored a JointState message about joint(s)"
                f' "{names[0]}"(,...) whose position member was empty.'
            )

    def _messages(self, frames: Iterable[Placed], stamp: Any) -> list[TransformStamped]:
        return [_message(frame, self._prefix, stamp) for frame in frames]

    def _changed(self, parameters: list[Any]) -> None:
        """Apply parameters that were set while the node runs; they are valid."""
        for parameter in parameters:
            if parameter.name == "robot_description":
                self._use(parameter.value, parse(parameter.value))
            elif parameter.name == "publish_frequency":
                self._pace.frequency = parameter.value
            elif parameter.name == "frame_prefix":
                self._prefix = parameter.value
            elif parameter.name == "ignore_timestamp":
                self._ignores_stamps = parameter.value


def _is_frequency(value: float) -> bool:
    return 0 < value <= 1000


def _checked(parameters: list[Any]) -> SetParametersResult:
    """Refuse a robot description or a frequency that is not valid."""
    for parameter in parameters:
        if parameter.name == "robot_description":
            if not parameter.value:
                return SetParametersResult(successful=False, reason="Empty URDF is not allowed")
            try:
                parse(parameter.value)
            except UrdfError as error:
                return SetParametersResult(successful=False, reason=str(error))
        elif parameter.name == "publish_frequency" and not _is_frequency(parameter.value):
            return SetParametersResult(successful=False, reason=_FREQUENCY)
    return SetParametersResult(successful=True)


def _message(frame: Placed, prefix: str, stamp: Any) -> TransformStamped:
    message = TransformStamped(child_frame_id=prefix + frame.child)
    message.header.frame_id = prefix + frame.parent
    message.header.stamp = stamp
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y, moved.z = frame.transform.translation
    turned.x, turned.y, turned.z, turned.w = frame.transform.rotation
    return message


def read_description(words: list[str]) -> str:
    """The text of the URDF file that a command line names, "" for none; exits if it has none."""
    if not words:
        return ""
    try:
        with open(words[0], encoding="utf-8") as file:
            return file.read()
    except OSError as error:
        sys.exit(f"cannot read the URDF file {words[0]}: {error.strerror or error}")
    except UnicodeDecodeError:
        sys.exit(f"cannot read the URDF file {words[0]}: expected UTF-8 text")


def main(args: list[str] | None = None) -> None:
    """Publish until Ctrl-C; an argument is the name of a URDF file."""
    description = read_description(remove_ros_args(sys.argv if args is None else args)[1:])
    try:
        with rclpy.init(args=args):
            try:
                node = RobotStatePublisher(description)
            except (ValueError, ParameterException) as error:
                sys.exit(f"robot_state_publisher cannot start: {error}")
            rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
