"""The names that programs import from the compiled part of rclpy, mostly exceptions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ._impl.arguments import parse
from ._impl.lifecycle_states import TransitionCallbackReturnType
from .clock_type import ClockType
from .exceptions import (
    InvalidHandle,
    NodeNameNonExistentError,
    RCLError,
    RCLInvalidROSArgsError,
    RMWError,
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
    "RMWError",
    "SignalHandlerOptions",
    "TimerCancelledError",
    "TransitionCallbackReturnType",
    "UnknownROSArgsError",
    "UnsupportedEventTypeError",
    "rclpy_get_rmw_implementation_identifier",
    "rclpy_remove_ros_args",
    "rmw_qos_profile_t",
]

rclpy_get_rmw_implementation_identifier = get_rmw_implementation_identifier


def rclpy_remove_ros_args(pycli_args: Sequence[str]) -> list[str]:
    """The arguments of a command line that do not belong to ROS.

    Raises RuntimeError for ROS arguments that do not exist or cannot be read.
    """
    return parse(pycli_args).rest


class rmw_qos_profile_t:
    """The predefined profiles by name."""

    @staticmethod
    def predefined(qos_profile_name: str) -> Any:
        """The profile of `rclpy.qos` with this name. Raises ValueError for an unknown name."""
        from . import qos

        profile = getattr(qos, qos_profile_name, None)
        if not isinstance(profile, qos.QoSProfile):
            raise ValueError(f"Requested unknown rmw_qos_profile: {qos_profile_name}")
        return profile.get_c_qos_profile()
