"""`taskrpc export colcon` turns a folder of programs into packages that colcon builds."""

import os
import runpy
import subprocess
import sys
import types

import pytest

from taskrpc.cli.main import main
from tests.ros.colcon.conftest import _manifest


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
