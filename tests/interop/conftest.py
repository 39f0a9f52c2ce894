"""Tests with programs of other projects: `pytest -m interop`; needs the extra `interop`."""

from __future__ import annotations

import asyncio
import functools
import inspect
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from taskrpc.core.system.file_locks import locked

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
PACKAGES = "rclpy rmw-fastrtps-cpp std-srvs std-msgs test-msgs geometry-msgs lifecycle-msgs".split()
TOOLS = ["pytest", "pytest-asyncio", "pytest-xdist", "hypothesis"]
HAS_WHEELS = (
    sys.platform == "linux"
    and platform.machine() == "x86_64"
    and (3, 11) <= sys.version_info < (3, 15)
)
LIMIT = 180.0
"""Seconds for one async test, without its fixtures; only a test that hangs takes so long."""


def pytest_collection_modifyitems(items):
    """Mark all tests of this folder, and limit the time of the async ones."""
    for item in items:
        if FOLDER in item.path.parents:
            item.add_marker(pytest.mark.interop)
            if inspect.iscoroutinefunction(item.obj):
                item.obj = limited(item.obj)


def limited(test):
    """Return the test with a time limit; that of a fixture would not reach into the test."""

    @functools.wraps(test)
    async def with_limit(*args, **kwargs):
        async with asyncio.timeout(LIMIT):
            await test(*args, **kwargs)

    return with_limit


@pytest.fixture(scope="session")
def ros_python(tmp_path_factory):
    """The Python of an environment with the real rclpy and taskrpc."""
    if given := os.environ.get("TASKRPC_TEST_ROS"):
        return given
    if not HAS_WHEELS:
        pytest.skip("PyPI has wheels of rclpy for Linux on x86-64 and Python 3.11 to 3.14 only")
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # that of all processes of this session
    ready = folder / "ros-ready"
    python = str(folder / "ros" / "bin" / "python")
    with locked(folder / "ros.lock"):
        if not ready.exists():
            _make_environment(folder / "ros", python)
            ready.touch()
    return python


def _make_environment(folder, python):
    """Make the environment with this Python; without an index of packages, skip the test."""
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True, timeout=300)
    pip = [python, "-m", "pip", "install", "--quiet", "--no-compile"]
    install = [*pip, *(f"ros-{name}" for name in PACKAGES), *TOOLS]
    ended = subprocess.run(install, stderr=subprocess.PIPE, text=True, timeout=900)
    if ended.returncode:
        reason = ended.stderr.strip().splitlines()[-1]
        if os.environ.get("CI"):
            pytest.fail(f"cannot install the real rclpy: {reason}")
        pytest.skip(f"cannot install the real rclpy: {reason}")
    subprocess.run([*pip, "--editable", f"{ROOT}[tls]"], check=True, timeout=900)
