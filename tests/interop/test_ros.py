"""taskrpc on the real rclpy from PyPI, in an environment of its own.

The tests themselves are in `inside_ros`, because they run in that environment. To use an
environment that exists, set `TASKRPC_TEST_ROS` to its Python. Of the contract suite, the tests run
that need less than a minute; this command runs all of them:

    python -m pytest -m interop -n 5 -k ros tests/taskrpc/transport
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
TOOLS = ["pytest", "pytest-asyncio", "pytest-xdist", "hypothesis"]
LIMIT = 600.0
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
    own = [python, "-m", "pip", "install", "--quiet", "--editable", f"{ROOT}[tls]"]
    subprocess.run(own, check=True, timeout=900)
    return python


INSIDE = {
    # The tests wait for DDS most of the time, so several processes share the processors.
    "ROS programs": ["tests/interop/inside_ros/ros_programs.py", "-n", "4"],
    "messages": ["tests/interop/inside_ros/ros_messages.py"],
    "contract": [
        "tests/taskrpc/transport/contract",
        "-n",
        "5",
        "-k",
        "ros and (test_calls or test_programs or test_threads or test_exactly_once)"
        " or native and ros and test_services",
    ],
}
"""The tests that run in the environment, by what they are about."""
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


@pytest.mark.parametrize("what", INSIDE)
def test_inside_an_environment_with_the_real_rclpy(ros_python, what):
    command = [ros_python, "-X", "faulthandler", "-m", "pytest", "-q", "-m", "interop"]
    environment = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    ended = subprocess.run(
        [*command, *INSIDE[what]],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LIMIT,
    )
    assert ended.returncode == 0, report(ended.stdout)
    assert " passed" in ended.stdout
