"""Explains in one line the import of a ROS package that taskrpc does not have."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING

from srvgen.classes.importer import is_importing
from srvgen.files import archive
from srvgen.files.search import BUNDLED

if TYPE_CHECKING:
    from importlib.abc import MetaPathFinder
else:  # slow to import, and not needed
    MetaPathFinder = object

_TESTS = "start the programs in a test with `taskrpc.testing`, or with `subprocess`"
_COMMANDS = "use the commands `taskrpc service`, `topic`, `action`, `node`, `param` and `interface`"
_CHECKS = "it checks the style of a package; run `colcon test` on a real ROS 2"
_NONE = "run the program on a real ROS 2"
_CAMERAS = "use the camera functions of OpenCV; `cv_bridge` converts the images"
_NAV2 = "Nav2 runs only on a real ROS 2; taskrpc has its interfaces, in `nav2_msgs`"
_MOVEIT = "MoveIt runs only on a real ROS 2; taskrpc has its interfaces, in `moveit_msgs`"
_GAZEBO = "Gazebo runs only on a real ROS 2; taskrpc has its interfaces, in `ros_gz_interfaces`"
_WEBOTS = "Webots' launcher runs only on a real ROS 2"
_XACRO = "PyPI has it; run pip install xacro"
_MARKERS = "RViz shows its markers, and only a real ROS 2 has RViz"
_CONVERTER = "use `message_to_ordereddict` and `set_message_fields` of `rosidl_runtime_py`"
_NUMPY = "use `cv_bridge` for images, and `sensor_msgs_py.point_cloud2` for points"

_PYTHON = {
    **dict.fromkeys("launch_testing launch_testing_ros launch_pytest".split(), _TESTS),
    "image_geometry": _CAMERAS,
    **dict.fromkeys("nav2_simple_commander turtlebot4_navigation".split(), _NAV2),
    **dict.fromkeys(
        "launch_param_builder moveit moveit_commander moveit_configs_utils".split(), _MOVEIT
    ),
    **dict.fromkeys("gazebo_ros ros_gz_bridge ros_gz_sim".split(), _GAZEBO),
    "webots_ros2_driver": _WEBOTS,
    "interactive_markers": _MARKERS,
    "rclpy_message_converter": _CONVERTER,
    "ros2_numpy": _NUMPY,
    "xacro": _XACRO,
    **dict.fromkeys("ros2cli ros2node ros2param ros2pkg ros2service ros2topic".split(), _COMMANDS),
    **dict.fromkeys(
        "ament_copyright ament_flake8 ament_lint ament_mypy ament_pep257 ament_xmllint".split(),
        _CHECKS,
    ),
    **dict.fromkeys(
        "py_trees_ros rosidl_generator_py rpyutils rqt_gui_py".split(),
        _NONE,
    ),
}
"""Python packages of ROS 2, each with the advice for its users."""

_RQT = "taskrpc has no rqt, the windows of ROS 2;"
_PROGRAMS = {
    "rqt_console": f"{_RQT} to see the log messages: taskrpc topic echo /rosout",
    "rqt_graph": f"{_RQT} to see the connections: taskrpc node info NODE",
    "rqt_gui": f"{_RQT} the commands of `taskrpc` show and change the same",
    "rqt_reconfigure": f"{_RQT} to change parameters: taskrpc param set NODE NAME VALUE",
    "rqt_plot": f"{_RQT} to see the values: taskrpc topic echo TOPIC --field NAME --csv",
    "rviz2": "taskrpc has no rviz2; start it on a real ROS 2",
}
"""Packages of programs, each with the advice for its users."""

_CLONE = "in the src folder of your workspace, run git clone {} (no build is needed)"
_TELEOP = _CLONE.format("https://github.com/ros2/teleop_twist_keyboard")
_LASER = _CLONE.format("-b jazzy https://github.com/ros-perception/laser_geometry")
_PYTHON["teleop_twist_keyboard"] = f"it is in Python and runs here; {_TELEOP}"
_PYTHON["laser_geometry"] = f"its Python part runs here, its C++ library does not; {_LASER}"
_PROGRAMS |= {
    "joint_state_publisher_gui": (
        "taskrpc has no window with sliders; start joint_state_publisher, and publish positions on"
        " a topic of its parameter source_list"
    ),
    "slam_toolbox": (
        "its programs are in C++ and run only on a real ROS 2; taskrpc has only its definitions"
    ),
}

WHAT_RUNS = "taskrpc runs Python programs; C++ programs, rqt, RViz and Gazebo need a real ROS 2"
"""What runs here and what does not, in one sentence."""

_REPOSITORIES = {
    "motoros2_interfaces": "https://github.com/Yaskawa-Global/motoros2_interfaces",
    "nvblox_msgs": "https://github.com/NVIDIA-ISAAC-ROS/isaac_ros_nvblox",
    "rmf_fleet_msgs": "https://github.com/open-rmf/rmf_internal_msgs",
    "velodyne_msgs": "https://github.com/ros-drivers/velodyne",
}
"""Packages of definitions that programs import, each with the repository that has it."""

_INTERFACES = frozenset("custom_interfaces graph_msgs logging_demo pendulum_msgs".split())
_LIKE_INTERFACES = re.compile(r"\w+_(interfaces?|msgs?|srvs?)")


def explain_ros(name: str) -> str:
    """The explanation for a ROS package that taskrpc does not have; "" for any other package."""
    if hint := _PYTHON.get(name):
        return f"it is a package of ROS 2 that taskrpc does not have: {hint}"
    is_of_interfaces = name in _INTERFACES or name in _REPOSITORIES
    return _where_to_put_interfaces(name) if is_of_interfaces else ""


def explain_program(package: str) -> str:
    """What to do for the programs of a package that taskrpc does not have; "" if it is unknown."""
    if hint := _PROGRAMS.get(package) or _PYTHON.get(package):
        return hint
    if package.startswith("nav2_"):
        return _NAV2
    if (BUNDLED / package).is_dir() or archive.definitions(package):
        return f"taskrpc has only the definitions of {package}, no programs and no launch files"
    return ""


def explain_ros_or_interfaces(name: str) -> str:
    """As `explain_ros`, also for packages whose names end like those of interface packages."""
    return explain_ros(name) or (
        _where_to_put_interfaces(name) if _LIKE_INTERFACES.fullmatch(name) else ""
    )


def _where_to_put_interfaces(name: str) -> str:
    if repository := _REPOSITORIES.get(name):
        return f"taskrpc does not have these definitions; {_CLONE.format(repository)}"
    return (
        f"if it has interfaces, put its folder (with {name}/srv, {name}/msg) beside the program,"
        " or name the folder above it in TASKRPC_INTERFACE_PATH"
    )


class ExplainingFinder(MetaPathFinder):
    """Finds no module, but raises an `ImportError` with an explanation for some packages.

    Args:
        explain: returns the explanation for a package, "" for none.
    """

    def __init__(self, explain: Callable[[str], str]) -> None:
        self._explain = explain

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Raise ModuleNotFoundError with the explanation; return None if there is none."""
        if "." in fullname or not (reason := self._explain(fullname)):
            return None
        # Another finder may call this one and then look elsewhere, so only Python's import raises.
        called_by_import = "importlib._bootstrap" in sys._getframe(1).f_code.co_filename
        if called_by_import and is_importing():
            raise ModuleNotFoundError(f"No module named {fullname!r}; {reason}", name=fullname)
        return None
