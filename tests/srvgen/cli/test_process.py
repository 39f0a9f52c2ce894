"""Start and end of a command process: signals and standard streams."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.end_to_end,
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows sends Ctrl-C to whole consoles"),
]

SIGNAL_AT = """
import os, signal, sys

class SignalAt:
    "Sends the signal when the module is first imported."
    def find_spec(self, name, *_):
        if name == {module!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.{signal})

sys.meta_path.insert(0, SignalAt())
sys.argv[1:] = {argv!r}
from {package}.__main__ import {function}
sys.exit({function}())
"""
"""Starts a command as its script does; a signal arrives during one import."""


def ended(module, command, *argv, signal="SIGINT"):
    """Status and stderr of a command that gets a signal at the import of a module."""
    package = "srvgen" if command == "srvgen" else "taskrpc"
    function = {"taskrpc-server": "server", "taskrpc-call": "call"}.get(command, "main")
    program = SIGNAL_AT.format(
        module=module, argv=list(argv), package=package, function=function, signal=signal
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )
    return done.returncode, done.stderr


COMMANDS = [
    ("srvgen", "show", "std_msgs/msg/Header"),
    ("taskrpc", "ps"),
    ("taskrpc-call", "/nobody", "--timeout", "0.1"),
    ("taskrpc-server", "--db", ":memory:"),
]
EARLY = {
    "srvgen": ["srvgen.cli.main", "argparse", "srvgen.cli.commands"],
    "taskrpc": ["taskrpc.cli.main", "argparse", "taskrpc.cli.network.ps"],
    "taskrpc-call": ["taskrpc.cli.call", "taskrpc.core.system.os_errors", "asyncio"],
    "taskrpc-server": [
        "taskrpc.cli.robot.server.command_line",
        "asyncio",
        "taskrpc.program",
        "taskrpc.robot",
    ],
}


@pytest.mark.parametrize(
    ("module", "command"),
    [(module, command) for command in COMMANDS for module in EARLY[command[0]]],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_ctrl_c_during_an_import_ends_a_command_silently(module, command):
    assert ended(module, *command) == (130, "")


@pytest.mark.parametrize("module", EARLY["taskrpc-server"])
def test_sigterm_during_an_import_ends_a_server_with_success(module):
    assert ended(module, *COMMANDS[3], signal="SIGTERM") == (0, "")


@pytest.mark.parametrize("place", ["atexit", "threading._register_atexit"])
def test_ctrl_c_after_its_work_does_not_change_the_status_of_a_command(place):
    """The signal arrives while Python joins threads, or while it runs exit functions."""
    program = f"""
import atexit, os, signal, sys, threading
sys.argv[1:] = ["--version"]
from taskrpc.__main__ import main
code = main()
{place}{"" if "_" in place else ".register"}(os.kill, os.getpid(), signal.SIGINT)
sys.exit(code)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


def test_an_ignored_ctrl_c_stays_ignored():
    """A shell without job control starts background programs with SIGINT ignored."""
    program = """
import os, signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
from srvgen.cli import process
process.begin()
process.start_work()
os.kill(os.getpid(), signal.SIGINT)
"""
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


CLOSED = "cannot write to standard output: Bad file descriptor\n"
FULL = "cannot write to standard output: No space left on device\n"
HASH = "srvgen hash std_msgs/msg/Header"


def in_shell(command, streams):
    """Status and stderr of `MODULE ARGUMENTS` with a shell's redirections."""
    line = f"{sys.executable} -m {command} {streams}"
    done = subprocess.run(
        ["sh", "-c", line], capture_output=True, text=True, timeout=120, check=False
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("command", [HASH, "srvgen --help", "taskrpc ps", "taskrpc pkg -h"])
@pytest.mark.parametrize(("streams", "message"), [(">&-", CLOSED), (">/dev/full", FULL)])
def test_results_that_cannot_be_written_are_one_line_and_exit_1(command, streams, message):
    if streams == ">/dev/full" and not os.path.exists("/dev/full"):  # only Linux has it
        streams, message = ">&-", CLOSED
    assert in_shell(command, streams) == (1, message)


@pytest.mark.parametrize("command", [HASH, "taskrpc ps"])
@pytest.mark.parametrize("streams", ["<&-", "2>&-", "<&- 2>&-"])
def test_other_streams_that_are_closed_or_full_change_nothing(command, streams):
    assert in_shell(command, streams) == (0, "")


@pytest.mark.parametrize(
    ("command", "status"), [("taskrpc.cli.call /x --stdin", 2), ("taskrpc stop nothing", 1)]
)
def test_a_closed_stderr_keeps_the_status_of_a_mistake(command, status):
    assert in_shell(command, "<&- 2>&-") == (status, "")


def test_closed_stdin_gives_an_error_where_it_is_read():
    message = "expected text on standard input, but it is closed\n"
    assert in_shell("taskrpc.cli.call /x --stdin", "<&-") == (2, message)
    assert in_shell("taskrpc join -", "<&-") == (2, message)
    assert in_shell("taskrpc interface show -", "<&-") == (2, message)


def test_an_endless_stdin_is_refused():
    message = "expected at most 16 MiB of text on standard input, got more\n"
    assert in_shell("taskrpc.cli.call /x --stdin", "</dev/zero") == (2, message)


def test_a_new_file_never_becomes_a_standard_stream_that_was_closed():
    """Otherwise output for stdout or stderr would be written to the file."""
    program = (
        "from srvgen.cli import process; process.begin(); assert open('/dev/null').fileno() > 2"
    )
    line = f'{sys.executable} -c "{program}" <&- >&- 2>&-'
    assert subprocess.run(["sh", "-c", line], check=False).returncode == 0
