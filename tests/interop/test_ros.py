"""taskrpc on the real rclpy from PyPI, in an environment of its own.

The tests themselves are in `inside_ros`, because they run in that environment. To use an
environment that exists, set `TASKRPC_TEST_ROS` to its Python. Of the contract suite, the tests run
that need less than a minute. All of it needs two minutes, on a busy machine much more; in such an
environment, this command runs it:

    export FASTDDS_DEFAULT_PROFILES_FILE=$PWD/tests/interop/inside_ros/fast_dds.xml
    python -m pytest -m interop -n 5 -k ros tests/core/transport
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
FAST_DDS = ROOT / "tests" / "interop" / "inside_ros" / "fast_dds.xml"
LIMIT = 900.0
"""Seconds for all of them; a real ROS program may hang."""

INSIDE = [
    "tests/interop/inside_ros/ros_programs.py",
    "tests/interop/inside_ros/ros_messages.py",
    "tests/core/transport/contract",
    # The tests wait for DDS most of the time, so several processes share the processors.
    *("-n", "5", "--dist", "worksteal"),
    "-k",
    "ros_programs or ros_messages"
    " or ros and (test_actions or test_calls or test_programs or test_threads or test_exactly_once)"
    " or native and ros and test_services",
]
"""The tests that run in the environment: in one session, because each process reads them all."""
_CRASH = "Fatal Python error"
"""How Python's faulthandler begins."""


def report(output: str) -> str:
    """Return the end of what pytest printed; a crash of Python comes first."""
    before, crash, threads = output.partition(_CRASH)
    return f"{crash}{threads[:10_000]}\n[…]\n{output[-10_000:]}" if crash else before[-20_000:]


def test_report_of_a_crash_begins_with_the_threads():
    output = f"..{_CRASH}: Segmentation fault\n\nThread 1:\n" + 30_000 * "." + "\n1 failed"
    assert report(output).startswith(f"{_CRASH}: Segmentation fault\n\nThread 1:\n")
    assert report(output).endswith("1 failed")
    assert report("one\n1 failed") == "one\n1 failed"


def test_inside_an_environment_with_the_real_rclpy(ros_python):
    command = [ros_python, "-X", "faulthandler", "-m", "pytest", "-q", "-m", "interop"]
    environment = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    environment["FASTDDS_DEFAULT_PROFILES_FILE"] = str(FAST_DDS)
    ended = subprocess.run(
        [*command, *INSIDE],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LIMIT,
    )
    assert ended.returncode == 0, report(ended.stdout)
    assert " passed" in ended.stdout
