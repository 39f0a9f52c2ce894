"""A class with two robots: the lecture's programs reach the student's robot unchanged."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.interop, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
PATIENCE = 120.0
PROGRAM = """
import rclpy
from geometry_msgs.msg import PoseStamped
from my_robot_interfaces.srv import RobotTask
from rclpy.node import Node

rclpy.init()
node, poses = Node("task_client"), []
client = node.create_client(RobotTask, "robot_task")
node.create_subscription(PoseStamped, "robot_task/pose", poses.append, 10)
assert client.wait_for_service(timeout_sec=30.0)
for target in ("central", "dock"):
    request = RobotTask.Request(task_type="move", target=target, priority=5)
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future)
    print(future.result().message, future.result().task_id)
while not poses:
    rclpy.spin_once(node)
node.destroy_node()
rclpy.shutdown()
"""


class Machine:
    """A computer with state and runtime folders of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        for name in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
            (folder / name).mkdir(parents=True, mode=0o700)
            self.environment[name] = str(folder / name)

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start a command, with its output in one pipe."""
        return subprocess.Popen(
            [sys.executable, "-m", "taskrpc", *arguments],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, *arguments: str) -> str:
        """Run a command that succeeds; returns its output."""
        process = self.start(*arguments)
        said, _ = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, said
        return said


@pytest.fixture
def lecturer(tmp_path):
    """The lecturer's computer, which serves two robots and one page each."""
    machine = Machine(tmp_path / "lecturer")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    where = ["--address", "127.0.0.1", "--port", port]
    (machine.folder / "names").write_text("ada\ngrace\n")
    machine.strings = machine.run("classroom", *where, "--robots", "2", "--students", "names")
    server = machine.start("classroom", *where, "--web", "--serve", "--speed", "20")
    lines = [next(line for line in server.stdout if "ready: " in line) for _ in range(2)]
    assert {line.split()[2] for line in lines} == {"/robot_task", "/robot2/robot_task"}
    yield machine
    server.terminate()
    server.communicate(timeout=PATIENCE)
    assert server.returncode == 0


@pytest.mark.parametrize(
    ("name", "robot"), [("ada", "/robot_task"), ("grace", "/robot2/robot_task")]
)
def test_lectures_program_drives_the_robot_of_the_student(lecturer, tmp_path, name, robot):
    (line,) = [each for each in lecturer.strings.splitlines() if each.startswith(f"{name} ")]
    laptop = Machine(tmp_path / name)
    assert f"taskrpc-call {robot} " in laptop.run("join", line.split()[-1])
    (laptop.folder / "task_client.py").write_text(PROGRAM)
    said = laptop.run("run", "task_client.py").splitlines()
    assert said == ["Task queued: move 1", "Task queued: move 2"]
    assert "move central" in laptop.run("task", "list", "--all")
    other = ({"/robot_task", "/robot2/robot_task"} - {robot}).pop()
    assert "move" not in lecturer.run("task", "list", "--all", "--service", other)
    assert "http://127.0.0.1:" in lecturer.run("view", "--no-browser", "--service", other)
    said = lecturer.run("classroom", "reset", "--yes")
    assert f"{robot}: the queue is empty and the robot is at its start; 2 tasks" in said
    assert "move" not in laptop.run("task", "list", "--all")
