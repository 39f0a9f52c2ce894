"""The programs of the scenes do on the real rclpy what `taskrpc scene --like-ros` shows.

PyPI has no package `example_interfaces`, so the tests replace AddTwoInts by a type of `test_msgs`.
Of the scenes with a robot, only the one runs that searches the robot's service.
"""

import contextlib
import os
import re
import subprocess
import time

import pytest

from taskrpc.course.scenes.catalogue import SCENES, scene
from taskrpc.course.scenes.player import program_path
from tests.course.scenes.test_player import CURES, LIKE_ROS
from tests.ros_domains import own_domains

ALONE = [each.name for each in SCENES if not (each.robot or each.simulated)]
LIMIT = 15.0
"""Seconds until a program counts as hanging; the others end within five."""
FIELDS = {
    r"from example_interfaces\.srv import AddTwoInts": "from test_msgs.srv import BasicTypes",
    r"AddTwoInts": "BasicTypes",
    r"\b(request)?\.a\b": r"\1.int64_value",
    r"\b(request)\.b\b": r"\1.int32_value",
    r"\ba=": "int64_value=",
    r"\bb=request\.int64_value": "int32_value=0",
    r"\bb=": "int32_value=",
    r"\.sum\b": ".int64_value",
}
SERVER = """
import rclpy
from rclpy.node import Node
from test_msgs.srv import BasicTypes

rclpy.init()
node = Node("robot")
node.create_service(BasicTypes, "robot_task", lambda request, response: response)
print("ready", flush=True)
rclpy.spin(node)
"""


def translated(text):
    for pattern, replacement in FIELDS.items():
        text = re.sub(pattern, replacement, text)
    return text


@pytest.fixture
def output(ros_python, tmp_path):
    """Runs a program text on the real rclpy; returns its lines, and whether it had to be ended."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(next(own_domains()))}
    with contextlib.ExitStack() as stack:

        def start(text):
            path = tmp_path / f"program_{time.monotonic_ns()}.py"
            path.write_text(text, encoding="utf-8")
            command = [ros_python, "-u", path]
            program = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
            stack.enter_context(program)
            stack.callback(program.kill)
            return program

        def run(text, server=""):
            if server:
                assert start(server).stdout.readline() == "ready\n"
            program = start(text)
            try:
                return program.communicate(timeout=LIMIT)[0].splitlines(), False
            except subprocess.TimeoutExpired:
                program.kill()
                return program.communicate()[0].splitlines(), True

        yield run


@pytest.mark.parametrize("name", ALONE)
def test_problem_does_what_like_ros_shows(output, name):
    text = program_path(scene(name), cure=False).read_text(encoding="utf-8")
    lines, hangs = output(translated(text))
    assert hangs == scene(name).will_hang(like_ros=True)
    expected = [line for line in LIKE_ROS[name] if not line.startswith("still waits")]
    assert [line for line in expected if not any(each.startswith(line) for each in lines)] == []


@pytest.mark.parametrize("name", [name for name in ALONE if name != "deadlock"])
def test_cure_does_what_the_scene_shows(output, name):
    text = program_path(scene(name), cure=True).read_text(encoding="utf-8")
    lines, hangs = output(translated(text))
    assert not hangs
    assert [line for line in CURES[name] if line not in lines] == []


def test_cure_of_the_deadlock_gets_a_response(output):
    text = program_path(scene("deadlock"), cure=True).read_text(encoding="utf-8")
    lines, hangs = output(translated(text))
    assert not hangs
    assert lines[-1].startswith("21 doubled is")  # the type of the test has no second summand


def test_client_of_another_type_finds_no_server(output):
    text = program_path(scene("wrong-type"), cure=False).read_text(encoding="utf-8")
    assert output(text, SERVER) == (LIKE_ROS["wrong-type"], False)
