"""CMake packages of interfaces."""

from srvgen.files.search import Search
from tests.ros.colcon.conftest import _manifest


def test_interfaces_become_a_cmake_package_with_their_dependencies(made):
    folder = made[0] / "lamp_interfaces"
    manifest, build_type = _manifest(folder)
    assert build_type == "ament_cmake"
    assert manifest["depend"] == ["geometry_msgs"]
    assert manifest["member_of_group"] == ["rosidl_interface_packages"]
    cmake = (folder / "CMakeLists.txt").read_text()
    assert "find_package(geometry_msgs REQUIRED)\n" in cmake
    generated = '(${PROJECT_NAME}\n  "srv/Switch.srv"\n  DEPENDENCIES geometry_msgs\n)'
    assert f"rosidl_generate_interfaces{generated}" in cmake
    assert cmake.count("(") == cmake.count(")")
    assert str(Search([folder]).load("lamp_interfaces/srv/Switch").response.fields[0].name)


def test_definitions_that_only_taskrpc_has_are_exported(made):
    assert (made[0] / "my_robot_interfaces" / "srv" / "RobotTask.srv").is_file()
    assert not (made[0] / "geometry_msgs").exists()
