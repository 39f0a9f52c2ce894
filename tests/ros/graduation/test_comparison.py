"""`taskrpc graduate --run` runs a program with taskrpc and with a real rclpy, and compares."""

import os
import subprocess
import time
from pathlib import Path

import pytest

from taskrpc.cli.main import main

pytestmark = pytest.mark.real_time

ROOT = Path(__file__).parents[3]
LIMIT = 2
PROGRAM = """
import sys
import rclpy

def main():
    rclpy.init()
    node = rclpy.create_node("n")
    print(sys.argv[1:], node.get_name())
    rclpy.shutdown()

main()
"""
FAKE = """
class Node:
    def get_name(self):
        return {name!r}

def init():
    pass

def shutdown():
    {end}

def create_node(name):
    return Node()
"""


@pytest.fixture
def real(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    (tmp_path / "program.py").write_text(PROGRAM)

    def real(name="n", end="pass"):
        folder = tmp_path / "opt" / "rclpy"
        folder.mkdir(parents=True)
        (folder / "__init__.py").write_text(FAKE.format(name=name, end=end))
        monkeypatch.setenv("PYTHONPATH", f"{folder.parent}{os.pathsep}{ROOT}")

    return real


def test_same_output_is_reported_as_the_same(real, capsys):
    real()
    assert main(["graduate", "program.py", "--timeout", "120", "--run", "a", "--b"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "found nothing that a real ROS 2 would do differently",
        "ROS 2 prints the same and ends in the same way",
    ]


def test_different_output_and_exit_code_are_shown(real, capsys):
    real(name="m", end="raise SystemExit(3)")
    assert main(["graduate", "program.py", "--timeout", "120", "--run"]) == 1
    assert capsys.readouterr().out.splitlines()[1:] == [
        "--- taskrpc stdout",
        "+++ ROS 2 stdout",
        "@@ -1 +1 @@",
        "-[] n",
        "+[] m",
        "taskrpc: exit code 0; ROS 2: exit code 3",
    ]


class Hanging(subprocess.Popen):
    """Times out when the program hangs, however long its start takes on a busy machine."""

    def communicate(self, input=None, timeout=None):
        if timeout == LIMIT:
            while self.poll() is None:
                if os.path.exists("hangs"):
                    raise subprocess.TimeoutExpired(self.args, timeout)
                time.sleep(0.01)
        return super().communicate(input, timeout)


def test_program_that_hangs_on_real_ros_is_interrupted(real, monkeypatch, capsys):
    real(end="import time; open('hangs', 'w').close(); time.sleep(60)")
    monkeypatch.setattr(subprocess, "Popen", Hanging)
    assert main(["graduate", "program.py", "--timeout", str(LIMIT), "--run"]) == 1
    out = capsys.readouterr().out
    assert out.endswith("taskrpc: exit code 0; ROS 2: did not end\n")


def test_missing_real_ros_is_reported(real, monkeypatch, capsys):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    assert main(["graduate", "program.py", "--run"]) == 2
    assert capsys.readouterr().err == ("--run needs a real ROS 2: source its setup.bash first\n")


@pytest.mark.parametrize("arguments", [[".", "--run"], ["program.py", "another.py"]])
def test_wrong_usage_is_one_line(real, capsys, arguments):
    assert main(["graduate", *arguments]) == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith(("got .", "another.py"))
