"""A real server in a separate process, which all tests of this folder may call."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from taskrpc.cli.main import main

ROOT = Path(__file__).parents[2]

PROGRAM = """
import asyncio, srvgen, taskrpc

def add(request, response):
    response.sum = request.a + request.b
    return response

async def sleep(request, response):
    await asyncio.sleep(30)
    return response

def fail(request, response):
    raise RuntimeError("a secret of the server")

def refuse(request, response):
    raise taskrpc.HandlerError("RESOURCE_EXHAUSTED", "the table is full")

def end(request, response):
    import os
    os._exit(1)

async def main():
    add_type = srvgen.load("example_interfaces/srv/AddTwoInts")
    empty = srvgen.load("std_srvs/srv/Empty")
    async with taskrpc.Node("add_two_ints_server") as node, taskrpc.Node("other") as other:
        node.create_service(add_type, "add_two_ints", add)
        node.create_service(add_type, "_hidden", add)
        other.create_service(empty, "sleep", sleep)
        other.create_service(empty, "fail", fail)
        other.create_service(empty, "refuse", refuse)
        other.create_service(empty, "end", end)
        other.create_client(add_type, "add_two_ints")
        text = srvgen.load("std_msgs/msg/String")
        other.create_publisher(text, "told")
        other.create_subscription(text, "heard", print)
        # Told from within spin(), which by then hears signals.
        asyncio.get_running_loop().call_soon(lambda: print(node.address, flush=True))
        await node.spin()

taskrpc.run(main())
"""


class Server:
    """A running server program."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.runtime = folder / "runtime"
        self.runtime.mkdir(mode=0o700, parents=True)
        self.script = folder / "adder.py"
        self.script.write_text(PROGRAM, encoding="utf-8")
        self.process = subprocess.Popen(
            [sys.executable, str(self.script)],
            cwd=folder,
            env={**os.environ, "XDG_RUNTIME_DIR": str(self.runtime), "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="session")
def session_server(tmp_path_factory):
    started = Server(tmp_path_factory.mktemp("server") / "of students")
    yield started
    started.close()


@pytest.fixture
def server(session_server, monkeypatch):
    """The server that all tests share; the test sees it as its own user's."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(session_server.runtime))
    return session_server


@pytest.fixture
def own_server(tmp_path, monkeypatch):
    """A server that the test may end."""
    started = Server(tmp_path / "own")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(started.runtime))
    yield started
    started.close()


@pytest.fixture
def run(capsys):
    """Runs `taskrpc …` in this process: exit code, stdout, stderr."""

    def _run(*argv, command=main):
        code = command(argv)
        out, err = capsys.readouterr()
        return code, out, err

    return _run
