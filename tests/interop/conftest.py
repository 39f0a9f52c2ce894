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
def ros_python(tmp_path_factory, request):
    """The Python of an environment with the real rclpy and taskrpc."""
    if given := os.environ.get("TASKRPC_TEST_ROS"):
        return given
    if not HAS_WHEELS:
        pytest.skip("PyPI has wheels of rclpy for Linux on x86-64 and Python 3.11 to 3.14 only")
    folder = _shared_folder(tmp_path_factory)
    python = folder / "ros" / "bin" / "python"
    with locked(folder / "ros.lock"):
        if not (folder / "ros-ready").exists():
            make_environment(folder / "ros")
            packages = [*(f"ros-{name}" for name in PACKAGES), *TOOLS]
            _pip("--python", python, "install", "--no-compile", *packages)
            wheel = request.getfixturevalue("own_wheel")
            _pip("--python", python, "install", "--no-compile", f"{wheel}[tls]")
            (folder / "ros-ready").touch()
    return str(python)


@pytest.fixture(scope="session")
def ros_mcp_python(tmp_path_factory):
    """The Python of an environment with ros-mcp, which needs mcp 1; the extra `mcp` is mcp 2."""
    folder = _shared_folder(tmp_path_factory)
    python = folder / "ros-mcp" / "bin" / "python"
    with locked(folder / "ros-mcp.lock"):
        if not (folder / "ros-mcp-ready").exists():
            make_environment(folder / "ros-mcp")
            _pip("--python", python, "install", "--no-compile", "ros-mcp>=3.0")
            (folder / "ros-mcp-ready").touch()
    return str(python)


@pytest.fixture(scope="session")
def own_wheel(tmp_path_factory):
    """taskrpc's wheel, which pip builds once for all processes of the tests."""
    folder = _shared_folder(tmp_path_factory) / "own-wheel"
    with locked(folder.with_suffix(".lock")):
        if not (folder / "ready").exists():
            _pip("wheel", "--no-deps", "--wheel-dir", folder, ROOT)
            (folder / "ready").touch()
    (wheel,) = folder.glob("*.whl")
    return wheel


def make_environment(folder):
    """Make an environment for `pip --python`: its own pip would take most of the time."""
    command = [sys.executable, "-m", "venv", "--clear", "--without-pip", folder]
    subprocess.run(command, check=True, timeout=300)


def _shared_folder(tmp_path_factory):
    """Return the folder of all processes of this session."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


def _pip(*arguments):
    """Run pip; without an index of packages, skip the test."""
    command = [sys.executable, "-m", "pip", "--quiet", *arguments]
    ended = subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=900)
    if ended.returncode:
        problem = f"pip has failed: {(ended.stderr.strip() or '?').splitlines()[-1]}"
        if os.environ.get("CI"):
            pytest.fail(problem)
        pytest.skip(problem)
