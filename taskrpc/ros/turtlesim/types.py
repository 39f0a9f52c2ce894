"""The types of turtlesim: of the package `turtlesim`, as in ROS 2 Jazzy, or of `turtlesim_msgs`.

ROS 2 Kilted and later have them in `turtlesim_msgs`. TASKRPC_TURTLESIM_TYPES chooses the package.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

from taskrpc.errors import TaskRpcError, show_in_one_message

if TYPE_CHECKING:
    from turtlesim.action import RotateAbsolute
    from turtlesim.msg import Color, Pose
    from turtlesim.srv import Kill, SetPen, Spawn, TeleportAbsolute, TeleportRelative
else:
    _package = os.environ.get("TASKRPC_TURTLESIM_TYPES") or "turtlesim"
    if _package not in ("turtlesim", "turtlesim_msgs"):
        show_in_one_message()
        raise TaskRpcError(
            f"TASKRPC_TURTLESIM_TYPES: expected turtlesim or turtlesim_msgs, got {_package}"
        )
    RotateAbsolute = import_module(f"{_package}.action").RotateAbsolute
    _msg, _srv = import_module(f"{_package}.msg"), import_module(f"{_package}.srv")
    Color, Pose = _msg.Color, _msg.Pose
    Kill, SetPen, Spawn = _srv.Kill, _srv.SetPen, _srv.Spawn
    TeleportAbsolute, TeleportRelative = _srv.TeleportAbsolute, _srv.TeleportRelative

__all__ = [
    "Color",
    "Kill",
    "Pose",
    "RotateAbsolute",
    "SetPen",
    "Spawn",
    "TeleportAbsolute",
    "TeleportRelative",
]
