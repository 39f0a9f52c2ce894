"""The transform buffer of ROS's `tf2_py`: frames in a tree, each with a history of transforms.

`buffer_core` has the class that programs use through `tf2_ros.Buffer`. The tree behind it
(`frame_tree`, `time_cache`, `geometry`) is pure: it knows neither messages nor clocks nor threads.
Topics and waiting belong to `tf2_ros`.
"""

from .buffer_core import BufferCore
from .exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]
