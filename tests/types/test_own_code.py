"""mypy sees the messages and the ROS packages in our own code: it reports planted misspellings.

The number of public functions with `Any` may only fall.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from typing import TypeAlias

import pytest

from tests.source_tree import ROOT, source_files

_Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef

pytestmark = [pytest.mark.types, pytest.mark.real_time]

MOST_WITH_ANY = 766
"""Public functions with `Any`. Only lower it."""

REQUEST_FIELDS = {
    "taskrpc/robot/tasks/server.py": "request.task_type",
    "taskrpc/robot/fleet/server.py": "request.priority",
    "taskrpc/robot/tasks/services/action.py": "goal.target",
    "taskrpc/cli/robot/task/task_services.py": "request.revision",
    "taskrpc/ros/packages/rclpy/parameter_service.py": "request.depth",
    "taskrpc/course/labs/checks/lab3.py": "request.b",
    "taskrpc/ros/turtlesim/node.py": "request.theta",
    "taskrpc/ros/packages/tf2_ros/buffer_server.py": "request.target_frame",
    "taskrpc/ros/packages/demo_nodes_py/services/add_two_ints_server.py": "request.a",
    "taskrpc/bridges/rosbridge/rosapi.py": "request.default_value",
}
RESPONSE_FIELDS = {
    "taskrpc/robot/tasks/services/offered_tasks.py": "response.next_page",
    "taskrpc/robot/tasks/services/action.py": "result.success",
    "taskrpc/robot/tasks/services/topics.py": "message.header.frame_id",
    "taskrpc/cli/robot/task/task_services.py": "response.success",
    "taskrpc/cli/ros/param/param_services.py": "response.descriptors",
    "taskrpc/course/labs/checks/lab1.py": "response.sum",
    "taskrpc/course/labs/checks/lab5.py": "response.message",
    "taskrpc/ros/turtlesim/node.py": "_result.delta",
    "taskrpc/ros/packages/tf2_ros/buffer.py": "response.frame_yaml",
    "taskrpc/ros/packages/tf2_ros/buffer_server.py": "result.transform",
}
RCLPY_METHODS = {
    "taskrpc/ros/turtlesim/node.py": "create_subscription",
    "taskrpc/ros/turtlesim/teleop.py": "declare_parameter",
    "taskrpc/ros/turtlesim/mimic.py": "create_publisher",
    "taskrpc/ros/packages/demo_nodes_py/topics/talker.py": "create_timer",
    "taskrpc/ros/packages/robot_state_publisher/robot_state_publisher.py": "get_logger",
    "taskrpc/ros/packages/joint_state_publisher/joint_state_publisher.py": "create_publisher",
    "taskrpc/ros/packages/tf2_ros/buffer_server.py": "destroy_timer",
    "taskrpc/ros/packages/tf2_ros/transform_broadcaster.py": "create_publisher",
    "taskrpc/ros/packages/diagnostic_updater/updater.py": "get_clock",
    "taskrpc/ros/packages/tf2_ros/transform_listener.py": "create_subscription",
}


def _misspelled(path: str, name: str, lines: list[str]) -> int:
    """Misspell the first use of a name in a file's lines; return the number of the line."""
    use = re.compile(rf"(?<![\w`]){re.escape(name)}\b(?!`)")
    for number, line in enumerate(lines):
        if use.search(line) and not line.lstrip().startswith(("def ", "#", '"""')):
            lines[number] = use.sub(f"{name}z", line, count=1)
            return number + 1
    raise AssertionError(f"{path} does not use {name}: plant another misspelling")


def test_mypy_reports_each_planted_misspelling(tmp_path):
    planted: set[tuple[str, int]] = set()
    texts: dict[str, list[str]] = {}
    for plants in (REQUEST_FIELDS, RESPONSE_FIELDS, RCLPY_METHODS):
        assert len(plants) == 10
        for path, name in plants.items():
            lines = texts.setdefault(path, (ROOT / path).read_text("utf-8").splitlines())
            planted.add((path, _misspelled(path, name, lines)))
    cache = tmp_path / "cache"
    if (known := ROOT / ".mypy_cache").exists():  # then mypy reads only the misspelled modules
        shutil.copytree(known, cache)
    command = [sys.executable, "-m", "mypy", "--cache-dir", cache]
    for number, (path, lines) in enumerate(texts.items()):
        shadow = tmp_path / f"{number}.py"
        shadow.write_text("\n".join(lines) + "\n", encoding="utf-8")
        command += ["--shadow-file", path, shadow]
    output = subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout
    reports = re.findall(r"^(\S+?):(\d+): error: ", output.replace("\\", "/"), flags=re.M)
    assert {(path, int(line)) for path, line in reports} == planted, output


def _functions(body: list[ast.stmt]) -> Iterator[_Function]:
    """Yield the public functions of a module or class, and those of its public classes."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _functions(node.body)
        elif isinstance(node, _Function) and not node.name.startswith("_"):
            yield node


def _has_any(function: _Function) -> bool:
    given = function.args
    arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    written = [each.annotation for each in arguments if each is not None] + [function.returns]
    nodes = [node for each in written if each is not None for node in ast.walk(each)]
    return any(isinstance(node, ast.Name) and node.id == "Any" for node in nodes)


def test_public_functions_with_any_become_fewer():
    bodies = (ast.parse((ROOT / path).read_bytes()).body for path in source_files())
    count = sum(_has_any(each) for body in bodies for each in _functions(body))
    assert count <= MOST_WITH_ANY, "give the new functions types"
    assert count > MOST_WITH_ANY - 20, f"lower MOST_WITH_ANY to {count}"
