"""What programs import from rclpy's compiled part, mostly its exceptions."""

from __future__ import annotations

from collections.abc import Sequence

from ._arguments import parse
from ._transitions import TransitionCallbackReturnType
from .clock_type import ClockType
from .exceptions import (
    InvalidHandle,
    NodeNameNonExistentError,
    RCLError,
    RCLInvalidROSArgsError,
    TimerCancelledError,
    UnknownROSArgsError,
    UnsupportedEventTypeError,
)
from .signals import SignalHandlerOptions
from .utilities import get_rmw_implementation_identifier

__all__ = [
    "ClockType",
    "InvalidHandle",
    "NodeNameNonExistentError",
    "RCLError",
    "RCLInvalidROSArgsError",
    "SignalHandlerOptions",
    "TimerCancelledError",
    "TransitionCallbackReturnType",
    "UnknownROSArgsError",
    "UnsupportedEventTypeError",
    "rclpy_get_rmw_implementation_identifier",
    "rclpy_remove_ros_args",
]

rclpy_get_rmw_implementation_identifier = get_rmw_implementation_identifier


def rclpy_remove_ros_args(pycli_args: Sequence[str]) -> list[str]:
    """The arguments of a command line that are not ROS's.

    Raises RuntimeError for ROS arguments that do not exist or cannot be read.
    """
    return parse(pycli_args).rest
