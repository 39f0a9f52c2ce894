"""`taskrpc export colcon` turns a folder of programs into packages that colcon builds."""

import os
import re
import runpy
import subprocess
import sys
import types
from xml.etree import ElementTree

import pytest

from srvgen.files.search import Search
from taskrpc.cli.main import main

LAMP = """
from lamp_interfaces.srv import Switch
import common
import numpy
import rclpy
rclpy.init()
print(Switch.Response(colour=common.COLOUR))
"""
FADER = """
import rclpy
from my_robot_interfaces.srv import RobotTask
from common import COLOUR

def main():
    print(COLOUR)

if __name__ == "__main__":
    main()
"""
TAGS = set(
    "name version description maintainer license buildtool_depend depend exec_depend test_depend"
    " member_of_group export".split()
)


@pytest.fixture
def lesson(tmp_path, monkeypatch):
    folder = tmp_path / "lesson"
    (folder / "lamp_interfaces" / "srv").mkdir(parents=True)
    definition = "geometry_msgs/Point at\nbool on\n---\nstring colour\n"
    (folder / "lamp_interfaces" / "srv" / "Switch.srv").write_text(definition)
    (folder / "lamp.py").write_text(LAMP)
    (folder / "fader.py").write_text(FADER)
    (folder / "common.py").write_text("COLOUR = 'green'\n")
    (folder / "test_lamp.py").write_text("import pytest\n")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def made(lesson, capsys):
    assert main(["export", "colcon", "../out"]) == 0
    return lesson.parent / "out" / "src", capsys.readouterr().out


def _manifest(folder):
    root = ElementTree.parse(folder / "package.xml").getroot()
    assert (root.tag, root.get("format")) == ("package", "3")
    found = {}
    for element in root:
        found.setdefault(element.tag, []).append((element.text or "").strip())
    assert set(found) <= TAGS
    for once in ("name", "version", "description", "export"):
        assert len(found[once]) == 1
    assert re.fullmatch(r"\d+\.\d+\.\d+", found["version"][0])
    assert "@" in root.find("maintainer").get("email")
    assert found["name"] == [folder.name]
    return found, root.findtext("export/build_type")


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


def test_programs_become_a_python_package_for_setuptools(made, monkeypatch):
    folder = made[0] / "lesson"
    manifest, build_type = _manifest(folder)
    assert build_type == "ament_python"
    assert manifest["exec_depend"] == [
        "lamp_interfaces",
        "my_robot_interfaces",
        "python3-numpy",
        "rclpy",
    ]
    given = {}
    fake = types.ModuleType("setuptools")
    fake.setup, fake.find_packages = given.update, lambda **_: ["lesson"]
    monkeypatch.setitem(sys.modules, "setuptools", fake)
    runpy.run_path(str(folder / "setup.py"))
    assert given["entry_points"] == {
        "console_scripts": ["fader = lesson.fader:main", "lamp = lesson._scripts:lamp"]
    }
    for _, files in given["data_files"]:
        assert all((folder / file).is_file() for file in files)
    assert {path.name for path in (folder / "lesson").iterdir()} == {
        "__init__.py",
        "_scripts.py",
        "common.py",
        "fader.py",
        "lamp.py",
    }


def test_five_commands_build_and_run_the_workspace(made):
    assert made[1].partition("ROS 2:\n")[2].splitlines() == [
        "  cd ../out",
        "  source /opt/ros/$ROS_DISTRO/setup.bash",
        "  colcon build",
        "  source install/setup.bash",
        "  ros2 run lesson fader",
    ]


@pytest.mark.real_time
def test_the_workspace_runs_without_ros_too(made):
    for name, printed in (
        ("lamp", "lamp_interfaces.srv.Switch_Response(colour='green')\n"),
        ("fader", "green\n"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "taskrpc", "run", "lesson", name],
            cwd=made[0].parent,
            env={**os.environ},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.stdout, done.stderr) == (printed, "")


def test_nothing_is_overwritten(made, capsys):
    assert main(["export", "colcon", "../out"]) == 1
    assert "already exists" in capsys.readouterr().err


def test_folder_without_ros_programs_is_refused(tmp_path, capsys):
    (tmp_path / "plain.py").write_text("print(1)\n")
    assert main(["export", "colcon", str(tmp_path / "o"), "--from", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith("nothing to export in ")
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("name", ["my-lesson", "Lesson", "2nd"])
def test_invalid_package_name_is_refused(lesson, name, capsys):
    assert main(["export", "colcon", "../out", "--package-name", name]) == 1
    assert f"as the name of a package, got '{name}'" in capsys.readouterr().err


def test_syntax_error_is_reported_with_its_line(lesson, capsys):
    (lesson / "broken.py").write_text("x = 1\nimport (\n")
    assert main(["export", "colcon", "../out"]) == 1
    assert "broken.py:2: Python cannot read it" in capsys.readouterr().err


def test_existing_package_is_copied(lesson, capsys):
    package = lesson / "done"
    package.mkdir()
    (package / "package.xml").write_text("<package format='3'><name>done</name></package>")
    assert main(["export", "colcon", "../out"]) == 0
    copied = lesson.parent / "out" / "src" / "done" / "package.xml"
    assert copied.read_text() == "<package format='3'><name>done</name></package>"
