"""What packages of a robot's ROS 2 a Python program or a definition needs, by what it names."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable
from typing import NamedTuple

from srvgen.definitions.model import Definition, sections

OURS = frozenset({"taskrpc", "srvgen"})
"""What no robot has, unless it is installed there."""

NOT_IN_ROS = frozenset({"my_robot_interfaces", "taskrpc_interfaces"})
"""Packages of definitions that come with taskrpc, and not with ROS 2."""

_OF_ROS = frozenset(
    "action_tutorials_interfaces ament_index_python cv_bridge launch launch_ros message_filters"
    " nav2_msgs nav2_simple_commander rcl_interfaces rclpy rosbag2_py rosidl_runtime_py"
    " ros2_numpy tf2_geometry_msgs tf2_py tf2_ros tf_transformations control_msgs moveit_msgs"
    " image_transport_py".split()
)
_KEYS = {
    "PIL": "python3-pil",
    "aiohttp": "python3-aiohttp",
    "cv2": "python3-opencv",
    "flask": "python3-flask",
    "matplotlib": "python3-matplotlib",
    "networkx": "python3-networkx",
    "numpy": "python3-numpy",
    "pandas": "python3-pandas",
    "psutil": "python3-psutil",
    "pygame": "python3-pygame",
    "pytest": "python3-pytest",
    "requests": "python3-requests",
    "scipy": "python3-scipy",
    "serial": "python3-serial",
    "tkinter": "python3-tk",
    "yaml": "python3-yaml",
    "zmq": "python3-zmq",
}
"""What rosdep calls the Python packages that programs of robots often import."""


class Needs(NamedTuple):
    """What imports come to."""

    packages: list[str]
    """For `package.xml`: packages of ROS 2, and keys of rosdep."""
    unknown: list[str]
    """Modules that somebody has to see to."""


def needs_of(imported: Iterable[str], interfaces: Collection[str], own: Collection[str]) -> Needs:
    """What a program needs beside Python.

    Args:
        imported: the first parts of the names of the modules that it imports.
        interfaces: packages of definitions that are known.
        own: what comes with the program.
    """
    packages, unknown = set(), set()
    for name in imported:
        if name in own or (name in sys.stdlib_module_names and name not in _KEYS):
            continue
        if name in interfaces or name in _OF_ROS:
            packages.add(name)
        elif name in _KEYS:
            packages.add(_KEYS[name])
        else:
            unknown.add(name)
    return Needs(sorted(packages), sorted(unknown))


def packages_in(definitions: Iterable[Definition], package: str) -> list[str]:
    """The other packages that the definitions of a package refer to."""
    found: set[str] = set()
    for definition in definitions:
        if type(definition).__name__ == "ActionDef":
            found.add("action_msgs")
        for section in sections(definition):
            found |= {field.type.package for field in section.fields if field.type.package}
    return sorted(found - {package})
