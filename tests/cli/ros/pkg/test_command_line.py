"""`taskrpc pkg` creates and shows packages as `ros2 pkg` does."""

import subprocess
import sys

import pytest

from tests.cli.ros.pkg.conftest import _create_python


def test_packages_of_the_workspace_are_shown(pkg, tmp_path):
    _create_python(pkg)
    assert pkg("executables") == (0, "my_package my_node\n", "")
    assert pkg("executables", "my_package") == (0, "my_package my_node\n", "")
    assert pkg("prefix", "my_package") == (0, f"{tmp_path / 'my_package'}\n", "")
    assert pkg("xml", "my_package", "--tag", "depend") == (0, "rclpy\nexample_interfaces\n", "")
    assert pkg("xml", "my_package")[1].startswith('<?xml version="1.0"?>\n')
    listed = pkg("list")[1].splitlines()
    assert {"my_package", "std_srvs"} <= set(listed)


@pytest.mark.parametrize(
    ("verb", "said"),
    [
        ("prefix", "Package not found"),
        ("xml", "Package not found"),
        ("executables", "Package 'std_srv' not found"),
    ],
)
def test_unknown_package_is_an_error_with_similar_names(pkg, verb, said):
    assert pkg(verb, "std_srv") == (1, "", f"{said}\n  hint: did you mean std_srvs?\n")


def test_executables_of_a_package_that_taskrpc_contains_are_shown(pkg):
    names = ("draw_square", "mimic", "turtle_teleop_key", "turtlesim_node")
    shown = "".join(f"turtlesim {name}\n" for name in names)
    assert pkg("executables", "turtlesim") == (0, shown, "")
    where = pkg("executables", "turtlesim", "--full-path")[1].splitlines()
    assert where[-1] == "taskrpc.ros.turtlesim.node:main"


def test_executables_of_a_cmake_package_are_the_programs_that_it_installs(pkg, tmp_path):
    pkg("create", "lamp")
    scripts = tmp_path / "lamp" / "scripts"
    scripts.mkdir()
    for name in ("shine.py", "glow", "helper.py", "data.txt"):
        (scripts / name).write_text("#!/usr/bin/env python3\nprint(__name__)\n")
    (scripts / "data.txt").write_text("no program\n")
    cmake = tmp_path / "lamp" / "CMakeLists.txt"
    cmake.write_text(
        cmake.read_text()
        + "install(PROGRAMS\n  scripts/shine.py # the first\n"
        + '  "${CMAKE_CURRENT_SOURCE_DIR}/scripts/glow" scripts/data.txt\n'
        + "  DESTINATION lib/${PROJECT_NAME}\n)\n"
        + "# install(PROGRAMS scripts/helper.py DESTINATION x)\n"
        + "install(PROGRAMS scripts/helper.py DESTINATION lib/${PROJECT_NAME} RENAME help)\n"
    )
    assert pkg("executables", "lamp")[1] == "lamp glow\nlamp help\nlamp shine.py\n"
    assert pkg("executables", "--full-path")[1].splitlines()[0] == str(tmp_path / "lamp" / "glow")
    done = subprocess.run(
        [sys.executable, "-m", "taskrpc", "run", "lamp", "help"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("__main__\n", "")


def test_missing_tag_is_an_error(pkg):
    _create_python(pkg)
    assert "No elements with tag 'conflict' in" in pkg("xml", "my_package", "-t", "conflict")[2]
    assert "No elements with tag '[' in" in pkg("xml", "my_package", "-t", "[")[2]


def test_packages_that_taskrpc_contains_are_listed_and_found(pkg):
    known = pkg("list")[1].splitlines()
    assert {"robot_state_publisher", "tf2_ros", "turtlesim", "demo_nodes_cpp", "rclpy"} <= {*known}
    for name in ("robot_state_publisher", "turtlesim"):
        code, out, _ = pkg("prefix", name)
        assert code == 0
        assert out.rstrip().endswith(name)
