"""`package.xml` in formats 2 and 3: a package's name, maintainer and dependencies."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple
from xml.sax.saxutils import escape, quoteattr

from srvgen.definitions.model import Definition, sections
from srvgen.definitions.names import LOWER_RULE, is_package_name
from taskrpc.errors import TaskRpcError

_LINTERS = {
    "ament_cmake": ("ament_lint_auto", "ament_lint_common"),
    "ament_python": ("ament_copyright", "ament_flake8", "ament_pep257", "python3-pytest"),
}


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """The contents of a `package.xml`."""

    name: str
    build_type: Literal["ament_cmake", "ament_python"]
    maintainer: str
    email: str
    description: str = "TODO: Package description"
    license: str = "TODO: License declaration"
    version: str = "0.0.0"
    format: int = 3
    depends: tuple[str, ...] = ()
    exec_depends: tuple[str, ...] = ()
    buildtool: str = "ament_cmake"
    """The build tool of an ament_cmake package."""
    has_interfaces: bool = False
    """Whether the package contains definitions, from which code is generated."""
    is_linted: bool = True
    """Whether its tests include the linters, as `pkg create` adds them."""


def checked_name(name: str) -> str:
    """Return a package name; raises TaskRpcError if ROS 2 rejects it."""
    if is_package_name(name):
        return name
    raise TaskRpcError(f"expected {LOWER_RULE} as the name of a package, got {name!r}")


def package_xml(package: Manifest) -> str:
    """The text of a package's `package.xml`."""
    schema = f"http://download.ros.org/schema/package_format{package.format}.xsd"
    parts = [_facts(package), *_needs(package), _export(package)]
    body = "\n\n".join("\n".join(f"  {line}" for line in part) for part in parts if part)
    return (
        '<?xml version="1.0"?>\n'
        f'<?xml-model href="{schema}" schematypens="http://www.w3.org/2001/XMLSchema"?>\n'
        f'<package format="{package.format}">\n{body}\n</package>\n'
    )


def _facts(package: Manifest) -> list[str]:
    email = quoteattr(package.email)
    return [
        _tag("name", package.name),
        _tag("version", package.version),
        _tag("description", package.description),
        f"<maintainer email={email}>{escape(package.maintainer)}</maintainer>",
        _tag("license", package.license),
    ]


def _needs(package: Manifest) -> Iterator[list[str]]:
    if package.build_type == "ament_cmake":
        yield [_tag("buildtool_depend", package.buildtool)]
    yield [_tag("depend", name) for name in package.depends]
    if package.has_interfaces:
        yield [
            _tag("buildtool_depend", "rosidl_default_generators"),
            _tag("exec_depend", "rosidl_default_runtime"),
        ]
    yield [_tag("exec_depend", name) for name in package.exec_depends]
    if package.is_linted:
        yield [_tag("test_depend", name) for name in _LINTERS[package.build_type]]
    if package.has_interfaces:
        yield [_tag("member_of_group", "rosidl_interface_packages")]


def _export(package: Manifest) -> list[str]:
    return ["<export>", f"  {_tag('build_type', package.build_type)}", "</export>"]


def _tag(name: str, text: str) -> str:
    return f"<{name}>{escape(text)}</{name}>"


# Dependencies

OURS = frozenset({"taskrpc", "srvgen"})
"""Packages that a robot has only after the user installs taskrpc on it."""

NOT_IN_ROS = frozenset({"my_robot_interfaces", "taskrpc_interfaces"})
"""Packages of definitions that taskrpc contains and ROS 2 does not."""

_OF_ROS = frozenset(
    "action_tutorials_interfaces ament_index_python cv_bridge launch launch_ros message_filters"
    " nav2_common nav2_msgs nav2_simple_commander rcl_interfaces rclpy rosbag2_py rosidl_runtime_py"
    " ros2_numpy tf2_geometry_msgs tf2_py tf2_ros tf2_sensor_msgs tf2_tools"
    " tf_transformations control_msgs"
    " moveit_msgs image_transport_py diagnostic_updater image_geometry interactive_markers"
    " moveit rclpy_message_converter sensor_msgs_py launch_xml launch_yaml turtle_tf2_py".split()
)
"""Packages of ROS 2 that programs import, besides interface packages."""

_ROSDEP_KEYS = {
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
"""Rosdep's keys for the Python packages that robot programs often import."""


class Needs(NamedTuple):
    """The dependencies that a program's imports imply."""

    packages: list[str]
    """For `package.xml`: packages of ROS 2, and rosdep keys."""
    unknown: list[str]
    """Modules without a known package, which the user must install on the robot."""


def needs_of(imported: Iterable[str], interfaces: Collection[str], own: Collection[str]) -> Needs:
    """The packages that a program needs besides Python.

    Args:
        imported: the top-level modules that the program imports.
        interfaces: the known packages of definitions.
        own: the modules that come with the program.
    """
    packages, unknown = set(), set()
    for name in imported:
        if name in own or (name in sys.stdlib_module_names and name not in _ROSDEP_KEYS):
            continue
        if name in interfaces or name in _OF_ROS:
            packages.add(name)
        elif name in _ROSDEP_KEYS:
            packages.add(_ROSDEP_KEYS[name])
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
