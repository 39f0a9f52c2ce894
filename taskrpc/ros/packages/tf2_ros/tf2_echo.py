"""Prints the transform between two frames, again and again: `taskrpc run tf2_ros tf2_echo`."""

from __future__ import annotations

import math
import sys
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time
from rclpy.utilities import remove_ros_args
from tf2_py import TransformException
from tf2_py.geometry import angles_of_quaternion, matrix_of_quaternion

from .buffer import Buffer
from .transform_listener import TransformListener

_USAGE = """\
Usage: tf2_echo source_frame target_frame [echo_rate]

This will echo the transform from the coordinate frame of the source_frame
to the coordinate frame of the target_frame. \n\
Note: This is the transform to get data from target_frame into the source_frame.
Default echo rate is 1 if echo_rate is not given."""


def text_of(message: Any) -> str:
    """What tf2_echo prints for a TransformStamped."""
    stamp = message.header.stamp
    moved, turned = message.transform.translation, message.transform.rotation
    translation = (moved.x, moved.y, moved.z)
    rotation = (turned.x, turned.y, turned.z, turned.w)
    angles = angles_of_quaternion(rotation)
    rows = [
        (*row, shift)
        for row, shift in zip(matrix_of_quaternion(rotation), translation, strict=True)
    ]
    return "\n".join(
        [
            f"At time {stamp.sec}.{stamp.nanosec}",
            f"- Translation: [{_listed(translation)}]",
            f"- Rotation: in Quaternion (xyzw) [{_listed(rotation)}]",
            f"- Rotation: in RPY (radian) [{_listed(angles)}]",
            f"- Rotation: in RPY (degree) [{_listed(map(math.degrees, angles))}]",
            "- Matrix:",
            *("".join(f" {value:6.3f}" for value in row) for row in [*rows, (0, 0, 0, 1)]),
        ]
    )


def _listed(values: Any) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


class Echo(Node):
    """The node `tf2_echo`."""

    def __init__(self, source: str, target: str, rate: float) -> None:
        super().__init__("tf2_echo")
        self._frames = source, target
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, self)
        self._was_found = False
        self._timer = self.create_timer(1 / rate, self.echo)

    def echo(self) -> None:
        """Print the transform, or that it is not there yet."""
        source, target = self._frames
        found, why_not = self._buffer.can_transform_core(source, target, Time())
        if not found and not self._was_found:
            self.get_logger().info(
                f"Waiting for transform {source} ->  {target}: {why_not}",
                throttle_duration_sec=1.0,
            )
            return
        self._was_found = True
        try:
            print(text_of(self._buffer.lookup_transform_core(source, target, Time())), flush=True)
        except TransformException as error:
            print(f"Failure at {self.get_clock().now().nanoseconds / 1e9:.3f}")
            print(f"Exception thrown:{error}")
            print("The current list of frames is:")
            print(self._buffer.all_frames_as_string(), flush=True)


def _rate_of(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        sys.exit(f"Failed to convert rate argument '{text}' to a floating-point number")
    if not 0 < rate < math.inf:
        sys.exit(f"expected an echo rate above 0, in Hz, got {text}")
    return rate


def main(args: list[str] | None = None) -> None:
    """Print until Ctrl-C."""
    given = remove_ros_args(sys.argv if args is None else args)[1:]
    if len(given) not in (2, 3):
        print(_USAGE)
        sys.exit(1)
    rate = _rate_of(given[2]) if len(given) > 2 else 1.0
    try:
        with rclpy.init(args=args):
            node = Echo(given[0], given[1], rate)
            node.echo()
            rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
