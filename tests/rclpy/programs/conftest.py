"""Starts and runs ROS 2 programs."""

import pytest

from tests.rclpy.programs.running import domain_in, programs_in


@pytest.fixture
def ros(tmp_path, monkeypatch):
    """Starts programs with `taskrpc run`, in an empty folder and a domain of their own."""
    for name, value in domain_in(tmp_path).items():
        monkeypatch.setenv(name, value)
    with programs_in(tmp_path) as start:
        yield start


@pytest.fixture
def run(ros):
    """Runs a program to its end: its exit status, stdout and stderr."""

    def run(source, *arguments, name="program.py"):
        program = ros(source, *arguments, name=name)
        code = program.end()
        return code, program.out, program.err

    return run
