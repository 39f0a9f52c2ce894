"""Sends one static transform: `taskrpc run tf2_ros static_transform_publisher`."""

from __future__ import annotations

import random
import string
import sys
from typing import NamedTuple

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import ExternalShutdownException
from rclpy.logging import RcutilsLogger
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from tf2_py.geometry import Quaternion, Vector, quaternion_of_angles

from .static_transform_broadcaster import StaticTransformBroadcaster

_USAGE = """\
usage: static_transform_publisher [--x X] [--y Y] [--z Z] [--qx QX] [--qy QY] [--qz QZ] [--qw QW] \
[--roll ROLL] [--pitch PITCH] [--yaw YAW] --frame-id FRAME_ID --child-frame-id CHILD_FRAME_ID

A command line utility for manually sending a static transform.

If no translation or orientation is provided, the identity transform will be published.

The translation offsets are in meters.

The rotation may be provided with roll, pitch, yaw euler angles in radians, or as a quaternion.

required arguments:
  --frame-id FRAME_ID parent frame
  --child-frame-id CHILD_FRAME_ID child frame id

optional arguments:
  --x X                 x component of translation
  --y Y                 y component of translation
  --z Z                 z component of translation
  --qx QX               x component of quaternion rotation
  --qy QY               y component of quaternion rotation
  --qz QZ               z component of quaternion rotation
  --qw QW               w component of quaternion rotation
  --roll ROLL           roll component Euler rotation
  --pitch PITCH         pitch component Euler rotation
  --yaw YAW             yaw component Euler rotation"""

_TRANSLATION, _ANGLES, _QUATERNION = (
    "x y z".split(),
    "roll pitch yaw".split(),
    "qx qy qz qw".split(),
)
_FRAMES = "frame-id", "child-frame-id"
_OLD_STYLES = {
    8: [*_TRANSLATION, "yaw", "pitch", "roll", *_FRAMES],
    9: [*_TRANSLATION, *_QUATERNION, *_FRAMES],
}
"""The names of arguments without flags, by their number."""


_logger = RcutilsLogger()  # no node has been created yet, so its name is empty


class Arguments(NamedTuple):
    """The transform that a command line asks for."""

    translation: Vector
    rotation: Quaternion
    parent: str
    child: str
    is_old_style: bool


def parse(words: list[str]) -> Arguments | None:
    """The transform of a command line; None if it asks for help.

    Raises:
        ValueError: the text says what is wrong, as in ROS.
    """
    if "--help" in words or "-h" in words:
        return None
    if not words:
        raise ValueError("Not enough arguments to parse")
    values, unnamed = _divided(words)
    if unnamed:
        if len(unnamed) not in _OLD_STYLES:
            rest = " ".join(unnamed)
            raise ValueError(f"Extra unparsed arguments on command-line: {rest}")
        if values:
            raise ValueError("Cannot specify both new-style (flags) and old-style (arguments)")
        values = dict(zip(_OLD_STYLES[len(unnamed)], unnamed, strict=True))
    parent, child = (values.pop(name, "") for name in _FRAMES)
    prefix = "" if unnamed else "--"
    numbers = {name: _number(prefix + name, value) for name, value in values.items()}
    rotation = _rotation(numbers)
    if not parent:
        raise ValueError("Frame id must not be empty")
    if not child:
        raise ValueError("Child frame id must not be empty")
    x, y, z = (numbers.get(name, 0.0) for name in _TRANSLATION)
    return Arguments((x, y, z), rotation, parent, child, bool(unnamed))


def _divided(words: list[str]) -> tuple[dict[str, str], list[str]]:
    """The values of the flags by name, and the words that belong to no flag."""
    values, unnamed, rest = {}, [], iter(words)
    for word in rest:
        name = word.removeprefix("--")
        if word == name or name not in (*_TRANSLATION, *_ANGLES, *_QUATERNION, *_FRAMES):
            unnamed.append(word)
        elif (value := next(rest, None)) is None:
            raise ValueError(f"Not enough arguments for {word}")
        else:
            values[name] = value
    return values, unnamed


def _rotation(numbers: dict[str, float]) -> Quaternion:
    if numbers.keys().isdisjoint(_QUATERNION):
        return quaternion_of_angles(*(numbers.get(name, 0.0) for name in _ANGLES))
    if not numbers.keys().isdisjoint(_ANGLES):
        raise ValueError("Cannot specify both quaternion and Euler rotations")
    x, y, z = (numbers.get(name, 0.0) for name in _QUATERNION[:3])
    return (x, y, z, numbers.get("qw", 1.0))


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"Failed to parse {name} argument as float") from None


class Publisher(Node):
    """The node `static_transform_publisher_…`, which sends its transform when it is created."""

    def __init__(self, arguments: Arguments) -> None:
        suffix = "".join(random.choices(string.ascii_letters + string.digits, k=16))
        super().__init__(f"static_transform_publisher_{suffix}")
        message = TransformStamped(child_frame_id=arguments.child)
        message.header.frame_id = arguments.parent
        message.header.stamp = self.get_clock().now().to_msg()
        moved, turned = message.transform.translation, message.transform.rotation
        moved.x, moved.y, moved.z = arguments.translation
        turned.x, turned.y, turned.z, turned.w = arguments.rotation
        self._broadcaster = StaticTransformBroadcaster(self)
        self._broadcaster.sendTransform(message)
        self.get_logger().info(
            "Spinning until stopped - publishing transform\n"
            f"translation: ({_quoted(arguments.translation)})\n"
            f"rotation: ({_quoted(arguments.rotation)})\n"
            f"from '{arguments.parent}' to '{arguments.child}'"
        )


def _quoted(values: tuple[float, ...]) -> str:
    return ", ".join(f"'{value:f}'" for value in values)


def main(args: list[str] | None = None) -> None:
    """Send the transform, and keep it for later subscribers until Ctrl-C."""
    try:
        arguments = parse(remove_ros_args(sys.argv if args is None else args)[1:])
    except ValueError as error:
        _logger.error(f"error parsing command line arguments: {error}")
        print(_USAGE)
        sys.exit(1)
    if arguments is None:
        print(_USAGE)
        return
    if arguments.is_old_style:
        _logger.warning("Old-style arguments are deprecated; see --help for new-style arguments")
    if arguments.parent == arguments.child:
        sys.exit(
            f"cannot publish static transform from '{arguments.parent}' to '{arguments.child}',"
            " exiting: child_frame_id cannot equal frame_id"
        )
    try:
        with rclpy.init(args=args):
            rclpy.spin(Publisher(arguments))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
