"""The real rclpy, and the interface packages that ROS has built in this environment."""

from __future__ import annotations

import os
from functools import lru_cache
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from srvgen.files import archive
from srvgen.files.search import BUNDLED
from taskrpc.errors import TaskRpcError, TypeMismatch
from taskrpc.spi import KEPT_CLASSES

_OURS = Path(__file__).resolve().parents[2] / "ros" / "packages" / "rclpy"
_PARTS = (
    "context",
    "node",
    "executors",
    "exceptions",
    "qos",
    "event_handler",
    "serialization",
    "parameter",
)
_TASKRPC_PACKAGES = ("my_robot_interfaces", "taskrpc_interfaces")
"""The bundled packages that do not belong to ROS."""


class NotBuilt(TypeMismatch):
    """ROS has no generated classes for a type."""

    def __init__(self, type_name: str) -> None:
        package = type_name.partition("/")[0]
        self.package = package
        problem = f"ROS has not built the package {package} of {type_name}"
        super().__init__(f"{problem}; {_advice(package)}")


def _advice(package: str) -> str:
    """Return how to get a package for ROS: only those of ROS itself can be installed."""
    is_of_ros = (BUNDLED / package).is_dir() or bool(archive.definitions(package))
    if package in _TASKRPC_PACKAGES or not is_of_ros:
        return (
            "build the workspace that has this package with `colcon build`, and source its"
            " install/setup.bash (`taskrpc export colcon` makes a workspace)"
        )
    name = package.replace("_", "-")
    distribution = os.environ.get("ROS_DISTRO")
    if distribution:  # ROS's setup file sets it
        return f"install it: apt install ros-{distribution}-{name}"
    pip = f"pip install ros-{name} if PyPI has this package"
    return f"install it: apt install ros-$ROS_DISTRO-{name}, or {pip}"


def real_rclpy() -> Any:
    """Import ROS's own rclpy. Raises TaskRpcError if it is not there."""
    spec = find_spec("rclpy")
    if spec is None or spec.origin is None:
        raise TaskRpcError(
            "transport='ros' needs the real rclpy of ROS 2, which this Python cannot import; source"
            " ROS's setup file (source /opt/ros/$ROS_DISTRO/setup.bash), or install it from PyPI"
            " (pip install ros-rclpy ros-rmw-fastrtps-cpp)"
        )
    if Path(spec.origin).resolve().parent == _OURS:
        real = PathFinder.find_spec("rclpy")
        first = "" if real is not None else "source ROS's setup file, and "
        problem = "transport='ros' needs the real rclpy, but here rclpy is taskrpc's own"
        advice = f"{first}start the program with python instead of taskrpc run"
        raise TaskRpcError(f"{problem}; {advice}")
    try:
        for part in _PARTS:
            import_module(f"rclpy.{part}")
        return import_module("rclpy")
    except ImportError as error:
        problem = f"the real rclpy at {Path(spec.origin).parent} cannot be imported: {error}"
        raise TaskRpcError(f"{problem}; use the Python for which ROS was built") from None


_ACTION_PARTS = {
    "SendGoal": "SendGoalService",
    "GetResult": "GetResultService",
    "FeedbackMessage": "FeedbackMessage",
}
"""The services and messages that an action implies, and their names in its class `Impl`."""


def action_part(type_name: str) -> tuple[str, str]:
    """Return the action and the name in its `Impl` for a type that an action implies.

    Both are "" for other types.
    """
    action, _, suffix = type_name.rpartition("_")
    part = _ACTION_PARTS.get(suffix, "")
    return (action, part) if part and "/action/" in action else ("", "")


@lru_cache(KEPT_CLASSES)
def ros_class(type_name: str) -> Any:
    """Return the class that ROS has generated for `std_srvs/srv/Trigger`. Raises NotBuilt.

    The services and messages that an action implies are in the class of the action.
    """
    action, part = action_part(type_name)
    if action:
        return getattr(ros_class(action).Impl, part)
    package, _, rest = type_name.partition("/")
    kind, _, name = rest.partition("/")
    try:
        found: Any = getattr(import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError):
        raise NotBuilt(type_name) from None
    # The import hook of srvgen makes classes of packages that ROS has not built.
    if hasattr(found, "_TYPE") or not hasattr(type(found), "__import_type_support__"):
        raise NotBuilt(type_name)
    return found
