"""The solutions of labs 1 and 3 run on the real rclpy.

Its environment has no example_interfaces. So test_msgs/srv/BasicTypes stands in for AddTwoInts:
the import and the names of the fields are replaced, and nothing else. Lab 2's type would have to
be built by ROS 2's own tools.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

from taskrpc.labs.variants import Variant
from tests.labs.submissions import solution_of, submission

PATIENCE = 120.0
"""Seconds for one program; a real ROS program may hang."""
STAND_IN = {
    r"from example_interfaces\.srv import AddTwoInts": (
        "from test_msgs.srv import BasicTypes as AddTwoInts"
    ),
    r"\bRequest\(a=(\w+), b=(\w+)\)": r"Request(int64_value=\1, int32_value=\2)",
    r"\brequest\.a\b": "request.int64_value",
    r"\brequest\.b\b": "request.int32_value",
    r"\bresponse\.sum\b": "response.int64_value",
}


class Programs:
    """The programs of a solution, on the real rclpy."""

    def __init__(self, python, folder):
        self._python = python
        self._folder = folder
        self._environment = {name: it for name, it in os.environ.items() if "PYTEST" not in name}
        self._environment["ROS_DOMAIN_ID"] = str(os.getpid() % 100)
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
            for pattern, instead in STAND_IN.items():
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
