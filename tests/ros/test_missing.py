"""Importing a ROS package that taskrpc does not have fails with one line of advice."""

import importlib.util
import sys

import pytest

from srvgen.classes import importer, loader
from taskrpc.ros import hook
from taskrpc.ros.missing import explain_program


@pytest.fixture
def hooked(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    monkeypatch.setattr(loader, "_runtime_module", loader._runtime_module)
    importer.uninstall_import_hook()
    explaining = (hook._explaining_ros, hook._explaining_interfaces)
    for finder in (hook._finder, hook._workspace, *explaining):
        while finder in sys.meta_path:
            sys.meta_path.remove(finder)
    hook.install(tmp_path)
    yield
    importer.uninstall_import_hook()


@pytest.mark.usefixtures("hooked")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "launch_testing",
            "it is a package of ROS 2 that taskrpc does not have: start the programs in a test",
        ),
        (
            "ament_flake8.main",
            "it checks the style of a package; run `colcon test` on a real ROS 2",
        ),
        (
            "laser_geometry",
            "its Python part runs here, its C++ library does not; in the src folder",
        ),
        (
            "teleop_twist_keyboard",
            "it is in Python and runs here; in the src folder of your workspace, run git clone",
        ),
        ("image_geometry", "use the camera functions of OpenCV; `cv_bridge` converts the images"),
        ("nav2_simple_commander", "Nav2 runs only on a real ROS 2"),
        ("interactive_markers", "RViz shows its markers, and only a real ROS 2 has RViz"),
        ("rclpy_message_converter", "use `message_to_ordereddict` and `set_message_fields`"),
        ("ros2_numpy", "use `cv_bridge` for images, and `sensor_msgs_py.point_cloud2` for points"),
        ("turtlebot4_navigation.turtlebot4_navigator", "Nav2 runs only on a real ROS 2"),
        ("moveit.planning", "MoveIt runs only on a real ROS 2"),
        ("graph_msgs.msg", "put its folder (with graph_msgs/srv, graph_msgs/msg) beside"),
        (
            "velodyne_msgs.msg",
            "in the src folder of your workspace, run git clone https://github.com/ros-drivers/velodyne",
        ),
        ("grocery_interfaces", "or name the folder above it in TASKRPC_INTERFACE_PATH"),
        ("exampel_interfaces", "did you mean example_interfaces?"),
    ],
)
def test_import_error_names_the_package_and_the_remedy(name, said):
    with pytest.raises(ModuleNotFoundError) as caught:
        __import__(name)
    package = name.partition(".")[0]
    assert str(caught.value).startswith(f"No module named '{package}'; ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.name == package


@pytest.mark.usefixtures("hooked")
def test_existing_packages_are_imported():
    for name in ("shape_msgs.msg", "std_msgs.msg", "rosidl_runtime_py.convert"):
        assert __import__(name)


@pytest.mark.usefixtures("hooked")
def test_find_spec_finds_none_and_does_not_raise():
    assert importlib.util.find_spec("launch_testing") is None
    assert importlib.util.find_spec("grocery_interfaces") is None


@pytest.mark.usefixtures("hooked")
def test_other_missing_packages_have_pythons_message():
    with pytest.raises(ModuleNotFoundError, match=r"^No module named 'grocery_shop'$"):
        __import__("grocery_shop")


@pytest.mark.parametrize(
    ("package", "said"),
    [
        ("teleop_twist_keyboard", "runs here; in the src folder of your workspace, run git clone"),
        ("laser_geometry", "its Python part runs here, its C++ library does not; in the src"),
        ("slam_toolbox", "its programs are in C++ and run only on a real ROS 2"),
        ("robot_localization", "taskrpc has only the definitions of robot_localization"),
        ("std_msgs", "taskrpc has only the definitions of std_msgs"),
        ("joint_state_publisher_gui", "start joint_state_publisher"),
        ("gazebo_ros", "Gazebo runs only on a real ROS 2"),
        ("nav2_bringup", "Nav2 runs only on a real ROS 2"),
        ("xacro", "run pip install xacro"),
        ("rviz2", "taskrpc has no rviz2"),
        ("my_package", ""),
    ],
)
def test_advice_for_the_programs_of_a_package(package, said):
    advice = explain_program(package)
    assert said in advice
    assert bool(said) is bool(advice)
