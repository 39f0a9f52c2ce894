"""Commands and packages import only the modules that they need, so that they start fast."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest

import srvgen
import taskrpc

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

MISTAKES = (
    "difflib srvgen.diagnostics.line_hints "
    "srvgen.diagnostics.type_hints srvgen.diagnostics.line_errors "
    "srvgen.files.not_found"
    " srvgen.cli.report srvgen.files.warnings srvgen.files.fix"
)
"""Modules that only explain mistakes."""
ELSEWHERE = (
    "yaml rich sqlite3 uvloop importlib.metadata taskrpc.robot.tasks taskrpc.robot taskrpc.sync"
    " taskrpc.testing"
)
"""Modules that other commands and programs need."""
DEFINITIONS = (
    "srvgen.errors srvgen.definitions.names srvgen._runtime srvgen.classes.loader srvgen.parser"
)
NETWORK = "asyncio ssl socket logging msgspec pathlib tempfile"
"""Modules that only calls need."""

_AT_EXIT = """
import atexit, sys
atexit.register(lambda: print(*sys.modules, file=sys.stderr))
"""


def imported(program: str, *arguments: str) -> set[str]:
    """Return the modules that a new process has imported when it ends successfully."""
    root = Path(taskrpc.__file__).parents[1]
    before = f"import sys; sys.path.insert(0, {str(root)!r})"
    done = subprocess.run(
        [sys.executable, "-c", f"{before}{_AT_EXIT}{program}", *arguments],
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=30,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return set(done.stderr.splitlines()[-1].split())


def command(module: str, *arguments: str) -> set[str]:
    return imported(f"from {module} import main; sys.exit(main())", *arguments)


def needless(modules: set[str], unwanted: str) -> list[str]:
    """Return which of these modules are unwanted, or are parts of unwanted ones."""
    names = unwanted.split()
    return sorted(
        one for one in modules if any(one == name or one.startswith(f"{name}.") for name in names)
    )


def test_imported_modules_are_listed():
    assert needless(imported("import difflib, yaml"), "difflib yaml.nodes") == [
        "difflib",
        "yaml.nodes",
    ]


@pytest.mark.parametrize("package", ["taskrpc", "srvgen"])
def test_packages_import_almost_nothing(package):
    modules = imported(f"import {package}")
    assert needless(modules, f"typing re enum {NETWORK} {MISTAKES} {ELSEWHERE}") == []


@pytest.mark.parametrize("argv", [["service", "--help"], ["service", "call", "--help"]])
def test_help_of_a_command_imports_no_network(argv):
    modules = command("taskrpc.cli.main", *argv)
    assert needless(modules, f"typing {DEFINITIONS} {NETWORK} {MISTAKES} {ELSEWHERE}") == []


def test_help_of_taskrpc_imports_only_what_finds_the_commands_of_other_packages():
    modules = command("taskrpc.cli.main", "--help")
    needed = imported("import importlib.metadata")
    unwanted = f"typing {DEFINITIONS} {NETWORK} {MISTAKES} {ELSEWHERE}"
    assert needless(modules - needed, unwanted) == []


def test_rclpy_program_imports_no_rarely_needed_module(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    program = tmp_path / "program.py"
    program.write_text("import rclpy\nfrom rclpy.node import Node\nrclpy.init()\nNode('n')\n")
    modules = command("taskrpc.cli.main", "run", str(program))
    elsewhere = ELSEWHERE.replace("uvloop ", "").replace(" taskrpc.sync", "")
    assert needless(modules, f"{MISTAKES} {elsewhere} importlib.abc importlib.resources") == []


def test_help_of_taskrpc_call_imports_no_network():
    modules = command("taskrpc.cli.call", "--help")
    assert needless(modules, f"typing {DEFINITIONS} {NETWORK} {MISTAKES} {ELSEWHERE}") == []


@pytest.mark.parametrize(
    "request_",
    [
        ["example_interfaces/srv/AddTwoInts", "{a: 2, b: 3}"],
        ["a=2", "b=3"],
    ],
)
async def test_call_imports_only_the_modules_of_a_call(request_, tmp_path, monkeypatch):

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    add = srvgen.load("example_interfaces/srv/AddTwoInts")

    def answer(request, response):
        response.sum = request.a + request.b
        return response

    async with taskrpc.Node("adder") as node:
        node.create_service(add, "/add", answer)
        modules = await asyncio.to_thread(command, "taskrpc.cli.call", "/add", *request_)
    others = "json taskrpc.service concurrent.futures.thread"
    if sys.platform != "win32":  # where asyncio imports it
        others += " tempfile"
    unwanted = f"{MISTAKES} {ELSEWHERE} {others}"
    assert needless(modules, unwanted) == []


def test_srvgen_check_imports_neither_network_nor_diagnostics(tmp_path):
    file = tmp_path / "demo_msgs" / "srv" / "Ask.srv"
    file.parent.mkdir(parents=True)
    file.write_text("int64 a\n---\nint64 b\n", encoding="utf-8")
    modules = command("srvgen.cli.main", "check", str(file))
    mistakes = MISTAKES.replace(" srvgen.cli.report srvgen.files.warnings", "")
    unwanted = f"{mistakes} {ELSEWHERE} asyncio ssl taskrpc json xml tempfile zipfile"
    assert needless(modules, unwanted) == []


def test_help_of_srvgen_imports_no_generator():
    modules = command("srvgen.cli.main", "--help")
    unwanted = (
        "msgspec logging json srvgen.files.search "
        "srvgen.parser srvgen.classes.render srvgen.cli.commands"
    )
    assert needless(modules, f"{unwanted} {MISTAKES} {ELSEWHERE}") == []


def test_program_without_topics_imports_no_module_of_topics():
    modules = imported("""
import srvgen, taskrpc
Trigger = srvgen.load("std_srvs/srv/Trigger")
async def main():
    async with taskrpc.Node("both") as node:
        node.create_service(Trigger, "pull", lambda request, response: response)
        await node.create_client(Trigger, "pull").call(Trigger.Request())
taskrpc.run(main())
""")
    topics = (
        "taskrpc.topic taskrpc.core.introspection taskrpc.timer"
        " taskrpc.core.transport.pubsub.endpoint_topics"
        " taskrpc.core.transport.pubsub.publishing taskrpc.core.transport.pubsub.subscribing"
    )
    assert needless(modules, topics) == []
