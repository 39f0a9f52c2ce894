"""The ROS packages that taskrpc contains: their folders, and the executables of `taskrpc run`."""

from __future__ import annotations

from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parent / "packages"
"""The folder of the packages; each has its name in ROS."""

SHARES = {
    "demo_nodes_cpp": Path(__file__).parent / "shares" / "demo_nodes_cpp",
    "turtlesim": Path(__file__).parent / "turtlesim",
}
"""The share folders of packages that have launch files."""

EXECUTABLES = {
    "demo_nodes_py": {
        "talker": "demo_nodes_py.topics.talker:main",
        "listener": "demo_nodes_py.topics.listener:main",
        "add_two_ints_server": "demo_nodes_py.services.add_two_ints_server:main",
        "add_two_ints_client": "demo_nodes_py.services.add_two_ints_client:main",
    },
    "joint_state_publisher": {
        "joint_state_publisher": "joint_state_publisher.joint_state_publisher:main",
    },
    "robot_state_publisher": {
        "robot_state_publisher": "robot_state_publisher.robot_state_publisher:main",
    },
    "tf2_ros": {
        "buffer_server": "tf2_ros.buffer_server:main",
        "static_transform_publisher": "tf2_ros.static_transform_publisher:main",
        "tf2_echo": "tf2_ros.tf2_echo:main",
        "tf2_monitor": "tf2_ros.tf2_monitor:main",
        "view_frames": "tf2_tools.view_frames:main",  # ROS has it only in tf2_tools
    },
    "tf2_tools": {"view_frames": "tf2_tools.view_frames:main"},
    "turtle_tf2_py": {
        "turtle_tf2_broadcaster": "turtle_tf2_py.turtle_tf2_broadcaster:main",
    },
    "turtlesim": {
        "turtlesim_node": "taskrpc.ros.turtlesim.node:main",
        "turtle_teleop_key": "taskrpc.ros.turtlesim.teleop:main",
        "draw_square": "taskrpc.ros.turtlesim.draw_square:main",
        "mimic": "taskrpc.ros.turtlesim.mimic:main",
    },
    # The tutorials start these programs in C++; the ones in Python say and do the same.
    "demo_nodes_cpp": {
        "talker": "demo_nodes_py.topics.talker:main",
        "listener": "demo_nodes_py.topics.listener:main",
        "add_two_ints_server": "demo_nodes_py.services.add_two_ints_server:main",
        "add_two_ints_client": "demo_nodes_py.services.add_two_ints_client:main",
    },
}
"""The executables by package, each with its `module:function`."""


@cache
def packages() -> dict[str, Path]:
    """The folders of the packages that programs import, by name."""
    return {path.parent.name: path.parent for path in sorted(FOLDER.glob("*/__init__.py"))}
