"""`taskrpc router`: programs meet at it; its ends and its mistakes."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys

import pytest

from taskrpc import sync
from taskrpc.cli.main import main
from tests.core.transport.helpers import Add, add, ask

pytest.importorskip("zenoh")
pytestmark = pytest.mark.real_time


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_router_serves_until_a_signal(number, status):
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    command = [sys.executable, "-m", "taskrpc", "router", "--listen", place]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == f"taskrpc router ready: Zenoh at tcp/{place}\n"
        try:
            if status == 0:
                assert call_over(place) == 3
            process.send_signal(number)
            assert process.wait(60) == status or sys.platform == "win32"
            assert process.stderr.read() in ("", "\n")
        finally:
            process.kill()


def call_over(place):
    with sync.Node("server", transport="zenoh", peers=[place]) as node:
        node.create_service(Add, "add", add)
        client = node.create_client(Add, "add")
        assert client.wait_for_service(10)
        return client.call(ask(1, 2)).sum


def test_a_taken_address_is_one_line(zenoh_router, capsys):
    assert main(["router", "--listen", zenoh_router]) == 1
    error = capsys.readouterr().err
    assert error.startswith("cannot open a Zenoh session: ")
    assert "in use" in error
    assert error.count("\n") == 1


def test_an_invalid_address_is_refused(capsys):
    assert main(["router", "--listen", "not a place"]) == 1
    assert "expected HOST:PORT or tcp/HOST:PORT" in capsys.readouterr().err


def test_commands_use_zenoh(zenoh_router, capsys):
    over = ["--transport", "zenoh", "--connect", zenoh_router]
    with sync.Node("server", transport="zenoh", peers=[zenoh_router]) as node:
        node.create_service(Add, "add", add)
        assert main(["service", "list", "-t", *over]) == 0
        assert capsys.readouterr().out == "/add [example_interfaces/srv/AddTwoInts]\n"
        assert main(["node", "list", *over]) == 0
        assert capsys.readouterr().out == "/server\n"
        assert main(["service", "call", "/add", "a=1", "b=2", "--json", *over]) == 0
        assert capsys.readouterr().out == '{"sum": 3}\n'
    assert main(["service", "call", "/add", "a=1", "--timeout", "0.2", *over]) == 4
    assert "no program offers a service over zenoh in domain 0" in capsys.readouterr().err
