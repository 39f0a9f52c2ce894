"""`taskrpc top` on a real terminal, in a pipe, and for programs."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time

import pytest

import srvgen
import taskrpc
from taskrpc.cli.main import COMMANDS

pytestmark = pytest.mark.real_time

posix = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are POSIX's")
TOP = [sys.executable, "-m", "taskrpc", "top", "--period", "0.2"]


def call_add(server, times):
    """Call /add_two_ints, and once a service that fails."""

    async def main():
        add = srvgen.load("example_interfaces/srv/AddTwoInts")
        empty = srvgen.load("std_srvs/srv/Empty")
        async with taskrpc.Node("ada") as node:
            client = node.create_client(add, "add_two_ints")
            for number in range(times):
                assert (await client.call(add.Request(a=number, b=1))).sum == number + 1
            with pytest.raises(taskrpc.HandlerFailed):
                await node.create_client(empty, "refuse").call(empty.Request())

    asyncio.run(main())


def test_top_stands_among_the_commands_of_students():
    assert list(COMMANDS).index("top") < list(COMMANDS).index("shell")


def test_once_prints_lines_and_ends(server, run):
    code, out, err = run("top", "--once", "--period", "0.2")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].startswith("taskrpc top")
    assert [line.split()[0] for line in lines if line.startswith("/")][:2] == [
        "/add_two_ints",
        "/end",
    ]
    assert "/_hidden" not in out
    assert "\x1b" not in out
    assert "/_hidden" in run("top", "--once", "--period", "0.2", "--all")[1]


def test_json_lines_have_the_calls_that_other_programs_make(server):
    process = subprocess.Popen([*TOP, "--json"], stdout=subprocess.PIPE, text=True)
    try:
        json.loads(process.stdout.readline())  # measuring has begun
        call_add(server, 20)
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            found = json.loads(process.stdout.readline())
            services = {each["name"]: each for each in found["services"]}
            if services["/refuse"]["errors"]:
                break
        assert services["/add_two_ints"]["codes"] == {"OK": 20}
        assert 0 < services["/add_two_ints"]["p50_ms"] <= services["/add_two_ints"]["p99_ms"]
        assert services["/refuse"]["codes"] == {"RESOURCE_EXHAUSTED": 1}
        assert found["task_servers"] == []
        assert {node["name"] for node in found["nodes"]} >= {"/add_two_ints_server", "/other"}
    finally:
        process.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
        code = process.wait(20)
        process.stdout.close()
    assert os.name != "posix" or code == 130


def test_an_address_without_a_program_exits_with_4(run):
    code, out, err = run("top", "--once", "--json", "--connect", "127.0.0.1:1", "--period", "0.2")
    assert (code, out) == (4, "")
    assert json.loads(err)["error"] == "ServiceUnavailable"


def test_one_program_is_watched_by_its_address(server, run):
    code, out, _ = run("top", "--once", "--period", "0.2", "--connect", server.address)
    assert code == 0
    assert server.address in out.splitlines()[0]
    assert "/add_two_ints" in out


def test_without_programs_it_says_how_to_start_one(run, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    code, out, _ = run("top", "--once", "--period", "0.2")
    assert code == 0
    assert "No taskrpc program runs here. Start one: taskrpc-server" in out


@pytest.mark.parametrize("period", ["0", "61", "often"])
def test_an_impossible_period_is_wrong_usage(run, period):
    code, _, err = run("top", "--period", period)
    assert code == 2
    assert "expected a number from 0.2 to 60" in err


class PseudoTerminal:
    """`taskrpc top` in a pseudo-terminal of 80 columns and 24 rows."""

    def __init__(self):
        import fcntl
        import pty
        import struct
        import termios

        self.own, self.other = pty.openpty()
        fcntl.ioctl(self.own, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.before = termios.tcgetattr(self.other)
        # A size in the environment would take precedence over that of the terminal.
        fixed = ("COLUMNS", "LINES", "NO_COLOR")
        environment = {name: value for name, value in os.environ.items() if name not in fixed}
        environment["TERM"] = "xterm-256color"
        self.process = subprocess.Popen(
            TOP,
            stdin=self.other,
            stdout=self.other,
            stderr=self.other,
            env=environment,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        self.shown = b""

    def read_until(self, text):
        """Read what it draws; returns once it has drawn the text."""
        import select

        deadline = time.monotonic() + 20
        while text not in self.shown:
            assert select.select([self.own], [], [], deadline - time.monotonic())[0], self.shown
            self.shown += os.read(self.own, 65536)

    def press(self, keys):
        os.write(self.own, keys)

    def end(self):
        """Return the exit code, and whether the terminal is as it was before."""
        self.read_until(b"\x1b[?1049l")
        return self.process.wait(20), self.is_restored()

    def is_restored(self):
        import termios

        return termios.tcgetattr(self.other) == self.before and b"\x1b[?25h" in self.shown

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self.own)
        os.close(self.other)


@pytest.fixture
def terminal(server):
    opened = PseudoTerminal()
    yield opened
    opened.close()


@posix
@pytest.mark.parametrize(("end", "code"), [("q", 0), ("\x03", 130), ("TERM", 143)])
def test_the_terminal_is_restored_at_the_end(terminal, end, code):
    terminal.read_until(b"/add_two_ints")
    if end == "TERM":
        terminal.process.send_signal(signal.SIGTERM)
    else:
        terminal.press(end.encode())
    assert terminal.end() == (code, True)


@posix
def test_the_terminal_is_restored_while_ctrl_z_has_stopped_the_command(terminal):
    terminal.read_until(b"/add_two_ints")
    terminal.press(b"\x1a")
    terminal.read_until(b"\x1b[?1049l")
    _, status = os.waitpid(terminal.process.pid, os.WUNTRACED)
    assert os.WIFSTOPPED(status)
    assert terminal.is_restored()
    terminal.shown = b""
    terminal.process.send_signal(signal.SIGCONT)
    terminal.read_until(b"/add_two_ints")
    terminal.press(b"q")
    assert terminal.end() == (0, True)


@posix
def test_the_picture_follows_the_size_of_the_terminal(terminal):
    import fcntl
    import struct
    import termios

    terminal.read_until(b"PROGRAM")
    terminal.shown = b""
    fcntl.ioctl(terminal.own, termios.TIOCSWINSZ, struct.pack("HHHH", 12, 40, 0, 0))
    terminal.read_until(b"ERRORS\x1b[0m\r\n")  # the last column now
    terminal.press(b"q")
    assert terminal.end() == (0, True)
