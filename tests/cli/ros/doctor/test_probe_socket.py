"""`taskrpc doctor unix:/path` distinguishes the reasons why a connection to a socket fails."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import tempfile
import threading
from pathlib import Path

import pytest

import taskrpc
from taskrpc.cli.main import main
from taskrpc.cli.ros.doctor import probe
from tests.core.transport.helpers import Add, add
from tests.raw_servers import served

HAS_UNIX = hasattr(socket, "AF_UNIX") and os.name == "posix"
pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(not HAS_UNIX, reason="no unix sockets on this system"),
]


@pytest.fixture
def path():
    # pytest's own folders are too long for a socket's path on macOS.
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / "robot.sock"


def diagnose(place, capsys):
    code = main(["doctor", place, "--json"])
    found = json.loads(capsys.readouterr().out)
    problems = [(each["text"], each["advice"]) for each in found if each["state"] == "problem"]
    assert code == bool(problems)
    return problems, [each["text"] for each in found]


@pytest.fixture
def serving(path):
    """A server at the path, in a thread of its own."""
    ready, stop = threading.Event(), threading.Event()

    async def serve():
        async with taskrpc.Node("server", listen=f"unix:{path}") as node:
            node.create_service(Add, "add", add)
            ready.set()
            await asyncio.to_thread(stop.wait)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    ready.wait()
    yield
    stop.set()
    thread.join()


def test_working_server_is_no_problem(serving, path, capsys):
    problems, said = diagnose(f"unix:{path}", capsys)
    assert problems == []
    assert f"a program listens at {path}" in said
    assert f"unix:{path} offers /add" in said


def test_path_without_a_socket_is_a_problem(path, capsys):
    (((text, advice),), _) = diagnose(f"unix:{path}", capsys)
    assert text == f"there is no socket at {path}: No such file or directory"
    assert f"--listen unix:{path}" in advice


def test_file_that_is_no_socket_is_a_problem(path, capsys):
    path.write_text("precious")
    (((text, _),), _) = diagnose(f"unix:{path}", capsys)
    assert text == f"{path} is not a socket"


def test_socket_of_an_ended_server_is_a_problem(path, capsys):
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    (((text, advice),), _) = diagnose(f"unix:{path}", capsys)
    assert text == f"no program listens at {path}: the server that created it has ended"
    assert advice == f"start it again with --listen unix:{path}"


def test_foreign_program_at_the_socket_is_a_problem(path, capsys):
    sock = socket.socket(socket.AF_UNIX)
    sock.bind(str(path))
    sock.listen()
    with served(sock, lambda connection: connection.close()):
        (((text, advice),), _) = diagnose(f"unix:{path}", capsys)
    assert text.startswith(f"unix:{path}: the connection was lost")
    assert advice == "another program than taskrpc listens there"


@pytest.mark.parametrize("place", ["socket", "folder"])
async def test_socket_of_another_user_is_a_problem(path, monkeypatch, place):
    """Root, as whom tests may run, is never refused: so the system's answer is made up."""
    error = PermissionError(13, "Permission denied")

    async def refuse(path):
        raise error

    def stat(path):
        raise error

    with socket.socket(socket.AF_UNIX) as sock:
        sock.bind(str(path))
        if place == "socket":
            monkeypatch.setattr(asyncio, "open_unix_connection", refuse)
        else:
            monkeypatch.setattr(probe.os, "stat", stat)
        found = await probe.reach_socket(f"unix:{path}", probe.STEP_TIMEOUT)
        monkeypatch.undo()
    assert found.state == "problem"
    wanted = (
        f"the socket {path} belongs to another"
        if place == "socket"
        else f"have no access to {path.parent}"
    )
    assert wanted in found.text
    assert "the same user" in found.advice


def test_server_that_does_not_accept_connections_is_a_problem(path, monkeypatch):
    async def hang(path):
        await asyncio.sleep(60)

    with socket.socket(socket.AF_UNIX) as sock:
        sock.bind(str(path))
        monkeypatch.setattr(asyncio, "open_unix_connection", hang)
        found = asyncio.run(probe.reach_socket(f"unix:{path}", 0.01))
    assert found.text == f"the server at {path} accepted no connection within 0.01 s"


def test_unix_without_a_path_is_wrong_usage(capsys):
    assert main(["doctor", "unix:"]) == 2
    assert "expected unix:/path of the server's socket" in capsys.readouterr().err
