"""The `colcon` lines of tutorials succeed, and find mistakes in definitions."""

import os
import shutil
import subprocess

import pytest

from taskrpc.cli.main import main


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    for name in ("arms", "my_things"):
        (tmp_path / "src" / name).mkdir(parents=True)
        (tmp_path / "src" / name / "package.xml").write_text(
            f"<package><name>{name}</name></package>"
        )
    definition = tmp_path / "src" / "my_things" / "srv" / "Ask.srv"
    definition.parent.mkdir()
    definition.write_text("int64 a\n---\nint64 b\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def colcon(workspace, capsys):
    def colcon(*arguments):
        code = main(["colcon", *arguments])
        printed = capsys.readouterr()
        # without the seconds
        return code, [line.partition(" [")[0] for line in printed.out.splitlines()], printed.err

    return colcon


NOTE = "taskrpc: nothing was built: packages run from their sources here\n"


def test_build_prints_a_line_for_each_package(colcon):
    assert colcon("build", "--symlink-install") == (
        0,
        [
            "Starting >>> arms",
            "Finished <<< arms",
            "Starting >>> my_things",
            "Finished <<< my_things",
            "",
            "Summary: 2 packages finished",
        ],
        NOTE,
    )
    code, out, _ = colcon("build", "--packages-select", "arms")
    assert (code, out[-1]) == (0, "Summary: 1 package finished")


def test_build_finds_mistakes_in_definitions(colcon, workspace):
    (workspace / "src/my_things/srv/Ask.srv").write_text("int46 a\n---\n")
    code, out, err = colcon("build")
    assert code == 1
    assert out[3:] == [
        "Failed   <<< my_things",
        "",
        "Summary: 1 package finished",
        "  1 package failed: my_things",
    ]
    assert err.startswith("--- stderr: my_things\n")
    assert "int46" in err
    assert err.endswith(f"---\n{NOTE}")


def test_unknown_package_is_an_error(colcon):
    code, _, err = colcon("build", "--packages-select", "arm")
    assert (code, err) == (
        1,
        "no package 'arm' in the workspace here\n  hint: did you mean arms?\n",
    )


def test_list_prints_the_folders_of_packages(colcon):
    assert colcon("list") == (0, ["arms\tsrc/arms", "my_things\tsrc/my_things"], "")


def test_installation_of_a_real_colcon_is_not_changed(colcon, workspace):
    (workspace / "install").mkdir()
    (workspace / "install" / ".colcon_install_layout").write_text("isolated\n")
    colcon("build")
    assert [path.name for path in (workspace / "install").iterdir()] == [".colcon_install_layout"]


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not here")
def test_setup_files_define_ros2_in_the_shell(colcon, workspace):
    colcon("build")
    command = workspace / "taskrpc"
    command.write_text('#!/bin/sh\necho "ros2() { echo ros2 \\$@; }"\n')
    command.chmod(0o755)
    for name in ("setup.bash", "local_setup.bash", "setup.sh"):
        done = subprocess.run(
            ["bash", "-c", f"source install/{name}; ros2 topic list"],
            env={**os.environ, "PATH": f"{workspace}:{os.environ['PATH']}"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.stdout, done.stderr) == ("ros2 topic list\n", "")


def test_build_says_which_programs_do_not_run_here(colcon, workspace):
    (workspace / "src/arms/CMakeLists.txt").write_text(
        "project(arms)\nadd_executable(wave src/wave.cpp)\nadd_executable(grip src/grip.cpp)\n"
    )
    code, _, err = colcon("build")
    assert code == 0
    assert err == (
        f"{NOTE}taskrpc: not built: grip, wave of arms: taskrpc runs Python programs; C++ programs,"
        " rqt, RViz and Gazebo need a real ROS 2\n"
    )
