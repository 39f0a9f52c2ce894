"""Finding the real rclpy, and the packages that ROS has built."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

import taskrpc
from taskrpc.errors import TaskRpcError, TypeMismatch
from taskrpc.middleware.ros import installed
from taskrpc.middleware.ros.installed import NotBuilt, real_rclpy, ros_class
from tests.middleware.ros import fake_ros


@pytest.fixture(autouse=True)
def _forget():
    ros_class.cache_clear()
    yield
    ros_class.cache_clear()


def test_missing_rclpy_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(installed, "find_spec", lambda _: None)
    with pytest.raises(TaskRpcError, match=r"source ROS's setup file.*pip install ros-rclpy"):
        real_rclpy()


@pytest.mark.parametrize(("real", "first"), [(None, "source ROS's setup file, and "), (1, "")])
def test_our_own_rclpy_is_not_mistaken_for_the_real_one(monkeypatch, real, first):
    ours = Path(taskrpc.__file__).parent / "ros" / "packages" / "rclpy" / "__init__.py"
    spec = ModuleSpec("rclpy", None, origin=str(ours))
    monkeypatch.setattr(installed, "find_spec", lambda _: spec)
    monkeypatch.setattr(installed, "PathFinder", SimpleNamespace(find_spec=lambda _: real))
    with pytest.raises(TaskRpcError) as caught:
        real_rclpy()
    end = f"here rclpy is taskrpc's own; {first}start the program with python instead of taskrpc"
    assert end in str(caught.value)


def test_rclpy_that_cannot_be_imported_is_explained(monkeypatch, tmp_path):
    spec = ModuleSpec("rclpy", None, origin=str(tmp_path / "rclpy" / "__init__.py"))
    monkeypatch.setattr(installed, "find_spec", lambda _: spec)
    monkeypatch.setattr(installed, "import_module", _no_library)
    with pytest.raises(TaskRpcError, match=r"librcl\.so.*use the Python for which ROS was built"):
        real_rclpy()


def _no_library(_):
    raise ImportError("librcl.so: cannot open shared object file")


def test_generated_class_is_found(monkeypatch):
    module = ModuleType("door_msgs.srv")
    module.Open = fake_ros.ros_service("std_srvs/srv/Trigger")
    monkeypatch.setitem(sys.modules, "door_msgs", ModuleType("door_msgs"))
    monkeypatch.setitem(sys.modules, "door_msgs.srv", module)
    assert ros_class("door_msgs/srv/Open") is module.Open


def test_parts_of_an_action_are_found_in_the_class_of_the_action(monkeypatch):
    module = ModuleType("door_msgs.action")
    module.Open = fake_ros.ros_action("test_msgs/action/Fibonacci")
    monkeypatch.setitem(sys.modules, "door_msgs", ModuleType("door_msgs"))
    monkeypatch.setitem(sys.modules, "door_msgs.action", module)
    assert ros_class("door_msgs/action/Open") is module.Open
    assert ros_class("door_msgs/action/Open_SendGoal") is module.Open.Impl.SendGoalService
    assert ros_class("door_msgs/action/Open_GetResult") is module.Open.Impl.GetResultService
    assert ros_class("door_msgs/action/Open_FeedbackMessage") is module.Open.Impl.FeedbackMessage


@pytest.mark.parametrize("package", ["door_msgs", "my_robot_interfaces", "taskrpc_interfaces"])
def test_package_of_the_user_is_to_be_built_and_not_installed(monkeypatch, package):
    monkeypatch.setenv("ROS_DISTRO", "kilted")
    with pytest.raises(NotBuilt) as caught:
        ros_class(f"{package}/srv/Open")
    text = str(caught.value)
    assert f"ROS has not built the package {package} of {package}/srv/Open; build" in text
    assert "`colcon build`" in text
    assert "taskrpc export colcon" in text
    assert "install it" not in text
    assert isinstance(caught.value, TypeMismatch)  # calls end with it at once, without retries


@pytest.mark.parametrize(
    ("distribution", "command"),
    [
        ("kilted", "apt install ros-kilted-nav-msgs$"),
        (
            "",
            r"apt install ros-\$ROS_DISTRO-nav-msgs, or pip install ros-nav-msgs if PyPI has this",
        ),
    ],
)
def test_package_of_ros_is_to_be_installed(monkeypatch, distribution, command):
    monkeypatch.setenv("ROS_DISTRO", distribution)
    problem = "ROS has not built the package nav_msgs of nav_msgs/srv/GetMap"
    with pytest.raises(NotBuilt, match=f"{problem}; install it: {command}"):
        ros_class("nav_msgs/srv/GetMap")


def test_class_of_the_import_hook_does_not_count_as_built(monkeypatch):
    import srvgen

    module = ModuleType("std_srvs.srv")
    module.Trigger = srvgen.load("std_srvs/srv/Trigger")
    monkeypatch.setitem(sys.modules, "std_srvs", ModuleType("std_srvs"))
    monkeypatch.setitem(sys.modules, "std_srvs.srv", module)
    with pytest.raises(NotBuilt):
        ros_class("std_srvs/srv/Trigger")
