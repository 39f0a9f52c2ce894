"""The solutions of labs 1, 3, 4 and 6 run on the real rclpy.

Its environment has no example_interfaces. So test_msgs/srv/BasicTypes stands in for AddTwoInts:
the import and the names of the fields are replaced, and nothing else. Another type stands in for
that of lab 4; lab 6 has only types of std_srvs. The types of labs 2 and 5 would have to be built
by ROS 2's own tools.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

from taskrpc.course.labs.variants import Variant
from tests.labs.submissions import solution_of, submission
from tests.ros_domains import own_domains

PATIENCE = 120.0
"""Seconds for one program; a real ROS program may hang."""
ADD_TWO_INTS = {
    r"from example_interfaces\.srv import AddTwoInts": (
        "from test_msgs.srv import BasicTypes as AddTwoInts"
    ),
    r"\bRequest\(a=(\w+), b=(\w+)\)": r"Request(int64_value=\1, int32_value=\2)",
    r"\brequest\.a\b": "request.int64_value",
    r"\brequest\.b\b": "request.int32_value",
    r"\bresponse\.sum\b": "response.int64_value",
}
MOVE = {
    r"from lab4_interfaces\.srv import Move": (
        "from type_description_interfaces.srv import GetTypeDescription as Move"
    ),
    r"\btarget=target\b": "type_name=target",
    r"\brequest\.target\b": "request.type_name",
    r"\brequest_id=": "type_hash=",
    r"\brequest\.request_id\b": "request.type_hash",
    r"\bresponse\.success\b": "response.successful",
    r"\bresponse\.message\b": "response.failure_reason",
}
STAND_INS = {1: ADD_TWO_INTS, 3: ADD_TWO_INTS, 4: MOVE, 6: {}}


class Programs:
    """The programs of a solution, on the real rclpy."""

    def __init__(self, python, folder):
        self._python = python
        self._folder = folder
        self._environment = {name: it for name, it in os.environ.items() if "PYTEST" not in name}
        self._environment["ROS_DOMAIN_ID"] = str(next(own_domains()))
        self._environment["PYTHONUNBUFFERED"] = "1"

    @contextlib.contextmanager
    def start(self, file, *arguments):
        """Start a program; it is killed at the end of the block if it still runs."""
        command = [self._python, file, *arguments]
        process = subprocess.Popen(
            command,
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            yield process
        finally:
            process.kill()
            process.communicate()

    def output(self, file, *arguments):
        """Run a program to its end; returns its lines."""
        with self.start(file, *arguments) as process:
            output, _ = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, output
        return output.splitlines()


def interrupted(process):
    """Press Ctrl-C, and return what the program printed."""
    process.send_signal(signal.SIGINT)
    return process.communicate(timeout=PATIENCE)[0]


@pytest.fixture
def programs_of(ros_python, tmp_path):
    def programs(number):
        submission(number, solution_of(number), tmp_path, Variant())
        for path in Path(tmp_path).glob("*.py"):
            text = path.read_text(encoding="utf-8")
            for pattern, instead in STAND_INS[number].items():
                text = re.sub(pattern, instead, text)
            path.write_text(text, encoding="utf-8")
        return Programs(ros_python, tmp_path)

    return programs


def test_lab_1_waits_for_its_server_and_adds(programs_of):
    programs = programs_of(1)
    with programs.start("client.py", "20", "22") as client:
        assert "waiting for the server" in client.stdout.readline()
        with programs.start("server.py") as server:
            output, _ = client.communicate(timeout=PATIENCE)
            assert output.splitlines()[-1] == "20 + 22 = 42"
            assert client.returncode == 0
            assert "20 + 22 = 42" in interrupted(server)


def test_lab_3_calls_one_after_another_and_at_the_same_time(programs_of):
    programs = programs_of(3)
    sums = ["1 + 10 = 11", "2 + 20 = 22", "3 + 30 = 33"]
    with programs.start("slow_server.py") as server:
        assert "the server is ready" in server.stdout.readline()
        lines = programs.output("sync_client.py")
        assert [line for line in lines if "=" in line] == sums
        lines = programs.output("async_client.py")
        assert sorted(line for line in lines if "=" in line) == sums
        first = next(place for place, line in enumerate(lines) if "=" in line)
        assert "tick" in lines[:first]
        began = re.findall(r"begins (\d+)", interrupted(server))
    assert sorted(began) == ["1", "1", "2", "2", "3", "3"]


def test_lab_4_repeats_a_lost_task_which_runs_once(programs_of):
    programs = programs_of(4)
    with programs.start("robot.py", "1") as robot:
        assert "ready" in robot.stdout.readline()
        lines = programs.output("client.py", "warehouse", "dock")
        told = interrupted(robot)
    answered = [line for line in lines if "the robot is at" in line]
    assert answered == [f"{name}: the robot is at {name}" for name in ("warehouse", "dock")]
    assert re.findall(r"I move to (\w+)", told) == ["warehouse", "dock"]
    assert told.count("I know this request_id") >= 1  # more if ROS loses a response as well


def test_lab_4_gives_up(programs_of):
    programs = programs_of(4)
    with programs.start("robot.py", "99") as robot:
        assert "ready" in robot.stdout.readline()
        lines = programs.output("client.py", "warehouse")
        received = interrupted(robot).count("my response gets lost")
    assert 1 <= received <= 4  # ROS loses requests as long as it has not found the server
    assert len([line for line in lines if "of 4: no response" in line]) == 4
    assert lines[-1] == "warehouse: no response"
    assert len([line for line in lines if "[ERROR]" in line]) == 1


def test_lab_6_corrected_programs_work_together(programs_of):
    programs = programs_of(6)
    with programs.start("robot.py") as robot, programs.start("planner.py") as planner:
        assert "ready" in robot.stdout.readline()
        assert "ready" in planner.stdout.readline()
        assert programs.output("console.py") == [
            "light: the light is on",
            "mission: battery: 87 percent; scan: 3 objects",
        ]
