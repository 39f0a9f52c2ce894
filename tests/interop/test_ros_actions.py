"""Programs with actions do the same, in the same order, on the real rclpy and here."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros_domains import own_domains

PROGRAM = Path(__file__).parent / "ros_actions_program.py"
LIMIT = 120.0
"""Seconds for one program; a real ROS program may hang."""
_STAMP = re.compile(r"\[\d{9,}\.\d{9}\]")


def output(command, program, *arguments):
    """Run the program: what it printed, and the lines of its log."""
    environment = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    environment["ROS_DOMAIN_ID"] = str(next(own_domains()))
    ended = subprocess.run(
        [*command, str(program), *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert ended.returncode == 0, ended.stderr
    log = [_STAMP.sub("[T]", line) for line in ended.stderr.splitlines() if _STAMP.search(line)]
    return ended.stdout.splitlines(), log


def sections(lines):
    """The lines of each step, sorted: threads print them in any order."""
    text = "\n".join(lines)
    return [sorted(section.splitlines()) for section in text.split("-- ")]


@pytest.mark.parametrize("kind", ["single", "multi"])
def test_a_program_with_actions_prints_the_same(ros_python, kind):
    there, log_there = output([ros_python], PROGRAM, kind)
    here, log_here = output([sys.executable, "-m", "taskrpc", "run"], PROGRAM, kind)
    assert len(there) > 80
    if kind == "single":
        assert here == there
    assert sections(here) == sections(there)
    assert log_here == log_there
