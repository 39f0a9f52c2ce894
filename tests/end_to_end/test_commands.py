"""The commands as users run them: processes, terminals of all code pages, Ctrl-C, a real server."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from taskrpc.cli.main import main

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
TRANSCRIPT = ROOT.parent / "shared" / "ros2" / "cli_transcript.txt"
ADD = "example_interfaces/srv/AddTwoInts"
ARABIC = "\u0627\u0644\u0645\u062d\u0637\u0629"
PATIENCE = 60

PROGRAM = """
import asyncio, srvgen, taskrpc

def add(request, response):
    response.sum = request.a + request.b
    return response

def answer(request, response):
    response.success = True
    response.message = f"on the way to {request.target}"
    return response

async def sleep(request, response):
    await asyncio.sleep(30)
    return response

async def main():
    async with taskrpc.Node("add_two_ints_server") as node:
        node.create_service(srvgen.load("example_interfaces/srv/AddTwoInts"), "add_two_ints", add)
        node.create_service(srvgen.load("my_robot_interfaces/srv/RobotTask"), "_task", answer)
        node.create_service(srvgen.load("std_srvs/srv/Empty"), "_sleep", sleep)
        print("ready", flush=True)
        await node.spin()

taskrpc.run(main())
"""


class Home:
    """A user's folder, with a server in it and a terminal."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("run", "state"):
            (folder / name).mkdir(mode=0o700, parents=True)
        self.environment = {
            **os.environ,
            "HOME": str(folder),
            "XDG_RUNTIME_DIR": str(folder / "run"),
            "XDG_STATE_HOME": str(folder / "state"),
            "PYTHONPATH": str(ROOT),
        }
        script = folder / "adder.py"
        script.write_text(PROGRAM, encoding="utf-8")
        self.server = self.start(str(script))
        assert self.server.stdout is not None
        assert self.server.stdout.readline().rstrip() == b"ready"

    def start(self, *argv: str, **variables: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, *argv],
            cwd=self.folder,
            env={**self.environment, **variables},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    def run(self, *argv: str, stdin: str = "", **variables: str) -> tuple[int, str, str]:
        """Run a command; returns exit code, stdout and stderr, in the terminal's encoding."""
        process = self.start("-m", *argv, **variables)
        out, err = process.communicate(stdin.encode(), PATIENCE)
        encoding = variables.get("PYTHONIOENCODING", "utf-8")
        texts = (each.decode(encoding).replace("\r\n", "\n") for each in (out, err))
        return process.returncode, *texts

    def close(self) -> None:
        self.server.kill()
        self.server.communicate()


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A home folder whose name contains spaces and foreign letters."""
    made = Home(tmp_path_factory.mktemp("home") / f"Ahmad {ARABIC} caf\u00e9")
    yield made
    made.close()


def recorded(command: str) -> tuple[int, str]:
    """Return the exit code and the output of a command in the transcript of real ROS 2."""
    if not TRANSCRIPT.is_file():
        pytest.skip("the transcript of real ROS 2 is not at hand")
    found = re.search(
        rf"^\$ {re.escape(command)}\n(.*?)^\[exit (\d+)\]$",
        TRANSCRIPT.read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    )
    assert found is not None, command
    return int(found[2]), found[1].replace("[stderr]\n", "")


GOLDEN = [
    ["service", "type", "/add_two_ints"],
    ["service", "type", "/nope"],
    ["service", "find", ADD],
    ["service", "find", "-c", ADD],
    ["service", "find", "std_srvs/srv/Empty"],
    ["service", "info", "/add_two_ints"],
    ["service", "info", "/nope"],
    ["service", "call", "/add_two_ints", ADD, "{a: 2, b: 3}"],
    ["service", "call", "add_two_ints", "example_interfaces/AddTwoInts", "a: 5"],
    ["service", "call", "/add_two_ints", ADD],
    ["service", "call", "/add_two_ints", ADD, "[1,2]"],
    ["service", "call", "/add_two_ints", ADD, "7"],
    ["service", "call", "/add_two_ints", "foo/srv/Bar", "{}"],
    ["service", "call", "/add_two_ints", "std_msgs/msg/String", "{}"],
    ["node", "list"],
    ["interface", "proto", ADD],
]


@pytest.mark.parametrize("argv", GOLDEN, ids=" ".join)
def test_output_begins_like_that_of_ros2(home, argv, monkeypatch, capsys):
    """The command runs in the process of the tests, for speed: other tests start processes."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", home.environment["XDG_RUNTIME_DIR"])
    code, expected = recorded(" ".join(["ros2", *argv]))
    assert main(argv) == code
    out, err = capsys.readouterr()
    assert (out + err).startswith(expected)
    assert out in ("", expected), "lines that only taskrpc prints go to stderr"


def test_taskrpc_call_prints_like_ros2_service_call(home):
    expected = (
        "requester: making request: example_interfaces.srv.AddTwoInts_Request(a=2, b=3)\n"
        "\n"
        "response:\n"
        "example_interfaces.srv.AddTwoInts_Response(sum=5)\n"
        "\n"
    )
    assert home.run("taskrpc.cli.call", "/add_two_ints", "a=2", "b=3") == (0, expected, "")
    assert home.run("taskrpc.cli.call", "/add_two_ints", ADD, "{a: 2, b: 3}")[1] == expected
    assert (
        home.run("taskrpc.cli.call", "add_two_ints", "--stdin", stdin="{a: 2, b: 3}")[1] == expected
    )


@pytest.mark.parametrize("encoding", ["cp1252", "cp1256", "utf-8"])
def test_output_is_right_in_every_code_page(home, encoding):
    code, out, err = home.run(
        "taskrpc.cli.call", "_task", f"target={ARABIC} caf\u00e9", PYTHONIOENCODING=encoding
    )
    assert (code, err) == (0, "")
    assert "on the way to" in out
    if encoding in ("cp1256", "utf-8"):
        assert ARABIC in out


@pytest.mark.parametrize(
    ("argv", "encoding"),
    [
        (["ps"], "cp1252"),
        (["doctor"], "cp1252"),
        (["service", "info", "-v", "add_two_ints"], "cp1256"),
    ],
)
def test_folders_with_spaces_and_foreign_letters_work_in_every_code_page(home, argv, encoding):
    code, out, err = home.run("taskrpc", *argv, PYTHONIOENCODING=encoding)
    assert (code, err) == (0, "")
    assert "Ahmad " in out


def test_json_output_is_always_ascii(home):
    _, out, _ = home.run("taskrpc.cli.call", "_task", f"target={ARABIC}", "--json")
    assert out.isascii()
    assert out.count("\n") == 1


INTERRUPTED = {
    "while it waits for a service": (["/nope", "--timeout", "60"], "stderr", b"waiting"),
    "while it waits for an answer": (["/_sleep", "--timeout", "60"], "stdout", b"requester"),
    "between two calls": (["/add_two_ints", "--rate", "0.1"], "stdout", b"Response"),
}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends Ctrl-C to whole consoles only")
@pytest.mark.parametrize("when", INTERRUPTED)
def test_ctrl_c_ends_a_call_silently(home, when):
    argv, stream, sign = INTERRUPTED[when]
    process = home.start("-m", "taskrpc.cli.call", *argv)
    for line in getattr(process, stream):
        if sign in line:
            break
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert b"Traceback" not in out + err
    assert b"Error" not in out + err
    assert time.monotonic() - began < 5


def test_closed_pipe_is_no_error(home):
    process = home.start("-m", "taskrpc", "interface", "list")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait(PATIENCE) == 0
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()
    process.stderr.close()


def test_python_m_taskrpc_and_the_modules_are_the_commands(home):
    assert home.run("taskrpc", "service", "list") == (0, "/add_two_ints\n", "")
    assert home.run("taskrpc.cli.main", "service", "list") == (0, "/add_two_ints\n", "")
    assert home.run("taskrpc.cli.call", "-h")[1].startswith("usage: taskrpc-call ")


def test_stop_ends_the_server_like_ctrl_c(home):
    code, out, err = home.run("taskrpc", "stop", "adder.py")
    assert (code, err) == (0, "")
    assert out == f"stopped adder.py (pid {home.server.pid})\n"
    # Windows cannot ask a process to end, it can only end it.
    assert home.server.wait(PATIENCE) == (15 if sys.platform == "win32" else 0)
    assert home.run("taskrpc", "ps", "--json") == (0, "[]\n", "")
