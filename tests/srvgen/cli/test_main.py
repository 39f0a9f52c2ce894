"""The `srvgen` command: its output on stdout and stderr, and its exit codes."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.srvgen.sample_definitions import put

pytestmark = pytest.mark.usefixtures("workspace")


def test_an_unknown_type_is_one_message_and_exit_1(run):
    code, out, err = run("hash", "example_interface/srv/AddTwoInts")
    assert (code, out) == (1, "")
    first, hint, looked = err.splitlines()
    assert first == "package 'example_interface' not found"
    assert hint == "  hint: did you mean example_interfaces?"
    assert looked.startswith(f"  looked in: {Path.cwd()}, ")
    assert looked.endswith(", the packages of srvgen")


@pytest.mark.parametrize(
    "arguments", [[], ["nonsense"], ["fix"], ["generate", "x"], ["check", "-I", "gone", "."]]
)
def test_wrong_usage_is_exit_2(run, arguments):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("usage: srvgen")


def test_log_record_of_the_library_is_one_line_on_stderr(run):
    put("std_srvs/srv/Extra", "---")
    code, _, err = run("hash", "std_srvs/srv/Trigger")
    assert code == 0
    assert err.startswith("note: std_srvs/srv/Trigger is not in ")
    assert err.count("\n") == 1


def test_the_command_runs_as_a_module_too(workspace):
    done = subprocess.run(
        [sys.executable, "-m", "srvgen", "hash", "nonsense"], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.startswith("expected a type name such as")


def test_help_and_version_and_a_misspelt_command(run):
    code, out, err = run()
    assert (code, out) == (2, "")
    assert "Report every problem in definitions" in err
    assert run("--version")[:2] == (0, f"srvgen {version('taskrpc')}\n")
    assert run("chek", "x")[2].endswith("error: unknown command 'chek'; did you mean check?\n")
    code, _, err = run("check", "-I", "gone", ".")
    assert (code, err.splitlines()[-1]) == (
        2,
        "srvgen check: error: argument -I: expected a folder, got a path that does not exist: gone",
    )
