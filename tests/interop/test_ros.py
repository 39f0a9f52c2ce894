"""taskrpc on the real rclpy from PyPI, in an environment of its own.

The tests themselves are in `inside_ros`, because they run in that environment. To use an
environment that exists, set `TASKRPC_TEST_ROS` to its Python. `TASKRPC_TEST_ROS_ALL=1` adds the ROS
programs and the contract suite: rclpy sometimes crashes there when a node is destroyed.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = "rclpy rmw-fastrtps-cpp std-srvs std-msgs test-msgs geometry-msgs".split()
TOOLS = ["pytest", "pytest-asyncio", "hypothesis"]
LIMIT = 1800.0
"""Seconds for one file; a real ROS program may hang."""
HAS_WHEELS = (
    sys.platform == "linux"
    and platform.machine() == "x86_64"
    and (3, 11) <= sys.version_info < (3, 15)
)


@pytest.fixture(scope="session")
def ros_python(tmp_path_factory):
    """The Python of an environment with the real rclpy and taskrpc."""
    if given := os.environ.get("TASKRPC_TEST_ROS"):
        return given
    if not HAS_WHEELS:
        pytest.skip("PyPI has wheels of rclpy for Linux on x86-64 and Python 3.11 to 3.14 only")
    folder = tmp_path_factory.mktemp("ros") / "environment"
    subprocess.run([sys.executable, "-m", "venv", folder], check=True, timeout=300)
    python = str(folder / "bin" / "python")
    wanted = [f"ros-{name}" for name in PACKAGES] + TOOLS
    install = [python, "-m", "pip", "install", "--quiet", *wanted]
    ended = subprocess.run(install, stderr=subprocess.PIPE, text=True, timeout=900)
    if ended.returncode:
        reason = ended.stderr.strip().splitlines()[-1]
        if os.environ.get("CI"):
            pytest.fail(f"cannot install the real rclpy: {reason}")
        pytest.skip(f"cannot install the real rclpy: {reason}")
    own = [python, "-m", "pip", "install", "--quiet", "--editable", str(ROOT)]
    subprocess.run(own, check=True, timeout=900)
    return python


INSIDE = {
    "ROS programs": ["tests/interop/inside_ros/ros_programs.py"],
    "messages": ["tests/interop/inside_ros/ros_messages.py"],
    # Each test takes seconds, so the case with a token runs the most important file only.
    "contract": [
        "tests/taskrpc/transport/contract",
        "tests/taskrpc/transport/pubsub",
        "-k",
        "native or test_calls",
    ],
}
"""The tests that run in the environment, by what they are about."""


@pytest.mark.parametrize("what", INSIDE)
def test_inside_an_environment_with_the_real_rclpy(ros_python, what):
    if what != "messages" and not os.environ.get("TASKRPC_TEST_ROS_ALL"):
        pytest.skip("set TASKRPC_TEST_ROS_ALL=1: rclpy sometimes crashes when a node is destroyed")
    command = [ros_python, "-m", "pytest", "-q", "-m", "interop", *INSIDE[what]]
    environment = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    ended = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LIMIT,
    )
    assert ended.returncode == 0, ended.stdout[-20_000:]
    assert " passed" in ended.stdout
