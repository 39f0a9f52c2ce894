"""Imports that a module may have: all others are refused, also in a module that is new.

The contracts of import-linter list source modules by hand and do not see new ones. Imports within
functions and for type checkers count, too.
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEMPLATES = (
    "taskrpc/course/labs/files/",
    "taskrpc/course/browser_lab/async_files/",
    "taskrpc/course/scenes/programs/",
)
"""Students' programs: they need not be valid Python."""

EVERYWHERE = {"msgspec", "yaml", "srvgen", "taskrpc", "typing_extensions"}
ALLOWED = {
    "IPython": ["taskrpc/course/notebook/jupyter.py"],
    "aiohttp": [
        "taskrpc/cli/bridge/command_line.py",
        "taskrpc/bridges/rosbridge/server.py",
        "taskrpc/observe/web/",
    ],
    "argcomplete": ["srvgen/cli/completion.py", "taskrpc/cli/shell.py"],
    "cryptography": ["taskrpc/course/classroom/authority.py"],
    "js": ["taskrpc/course/browser_lab/tab/"],
    "lz4": ["taskrpc/observe/recording/mcap_file.py"],
    "mcap": ["taskrpc/observe/recording/mcap_file.py"],
    "numpy": ["srvgen/classes/rosidl_classes.py", "taskrpc/ros/packages/"],
    "opentelemetry": ["taskrpc/observe/otel.py"],
    "psycopg": ["taskrpc/robot/fleet/postgres_connection.py"],
    "pyodide": ["taskrpc/course/browser_lab/tab/"],
    "rich": ["taskrpc/cli/"],
    "transforms3d": ["taskrpc/ros/packages/tf_transformations/"],
    "uvloop": ["taskrpc/program.py"],
    "zenoh": ["taskrpc/cli/router/command_line.py", "taskrpc/middleware/zenoh/"],
    "zstandard": ["taskrpc/observe/recording/mcap_file.py"],
}
"""Each package of others, and the modules or folders that may import it."""
ROS = re.compile(r"\w+_(msgs|srvs|interfaces|py|ros|python)|rclpy|launch|turtlesim")
ROS_FOLDERS = (
    "taskrpc/ros/",
    "taskrpc/ros/turtlesim/",
    "taskrpc/course/notebook/",
    "taskrpc/cli/launch.py",
)
"""Packages of ROS beside those in taskrpc/ros/packages, and where they may be imported."""

PURE = (
    "srvgen/cdr/",
    "srvgen/definitions/",
    "srvgen/diagnostics/",
    "taskrpc/core/request_ids/",
    "taskrpc/robot/tasks/queue/",
    "taskrpc/core/transport/tunnel/",
    "taskrpc/core/wire/",
)
SHELLS = {
    "taskrpc/robot/tasks/queue/task_queue.py": {"asyncio"},
    "taskrpc/core/transport/tunnel/handoff.py": {"asyncio"},
    "taskrpc/core/transport/tunnel/native.py": {"asyncio"},
    "taskrpc/core/transport/tunnel/stream_table.py": {"asyncio"},
    "taskrpc/core/transport/tunnel/stream_transport.py": {"asyncio"},
    "taskrpc/core/transport/tunnel/tunnel_network.py": {"asyncio"},
}
"""Modules of the pure folders that use the outside world, and what of it."""
OUTSIDE = {
    *("asyncio", "datetime", "http", "io", "multiprocessing", "os", "pathlib", "queue", "random"),
    *("secrets", "select", "shutil", "signal", "socket", "sqlite3", "ssl", "subprocess"),
    *("tempfile", "threading", "time", "urllib", "uuid"),
}
"""Modules for input and output, the clock, chance and threads."""


def imported(tree: ast.AST) -> set[str]:
    """The first parts of all absolute imports."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {each.name.partition(".")[0] for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def refused(path: str, text: str | bytes) -> set[str]:
    """The imports that a module with this path and text may not have."""
    names = imported(ast.parse(text))
    others = names - set(sys.stdlib_module_names) - EVERYWHERE
    wrong = {name for name in others if not is_allowed(name, path)}
    if path.startswith(PURE):
        wrong |= names & OUTSIDE - SHELLS.get(path, set())
    return wrong


def is_allowed(name: str, path: str) -> bool:
    if name in ALLOWED:
        return path.startswith(tuple(ALLOWED[name]))
    of_ros = ROS.fullmatch(name) or (ROOT / "taskrpc" / "ros" / "packages" / name).is_dir()
    return bool(of_ros) and path.startswith(ROS_FOLDERS)


def test_each_module_imports_only_what_it_may():
    found = {}
    for folder in ("srvgen", "taskrpc"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            path = file.relative_to(ROOT).as_posix()
            if not path.startswith(TEMPLATES) and (wrong := refused(path, file.read_bytes())):
                found[path] = wrong
    assert found == {}


@pytest.mark.parametrize(
    ("path", "text", "wrong"),
    [
        ("taskrpc/ros/packages/rclpy/node.py", "import mcap, psycopg", {"mcap", "psycopg"}),
        ("taskrpc/new.py", "def f():\n    from aiohttp import web", {"aiohttp"}),
        ("taskrpc/new.py", "import requests", {"requests"}),
        ("taskrpc/node.py", "import std_msgs.msg", {"std_msgs"}),
        ("taskrpc/core/wire/new.py", "import socket", {"socket"}),
        ("taskrpc/robot/tasks/queue/new.py", "from time import monotonic", {"time"}),
        ("srvgen/cdr/new.py", "import os.path, msgspec, struct", {"os"}),
    ],
)
def test_wrong_imports_are_found(path, text, wrong):
    assert refused(path, text) == wrong
