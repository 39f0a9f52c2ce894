"""A program elsewhere is called with its secret."""

from __future__ import annotations

import pytest

import srvgen
from taskrpc import sync
from taskrpc.cli.call import main as call_main
from taskrpc.cli.main import main
from taskrpc.cli.shared.remote import Remote

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    response.sum = request.a + request.b
    return response


@pytest.mark.real_time
def test_remote_program_is_called_with_its_token(tmp_path, monkeypatch, capsys):
    """Another runtime folder stands for another machine: no token is found there."""
    secret = tmp_path / "secret.txt"
    secret.write_text("open sesame\n")
    secret.chmod(0o600)
    with sync.Node("server", token="open sesame") as node:
        node.create_service(ADD, "add", add)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "elsewhere"))
        there = ["--connect", node.address]
        assert call_main(["/add", "a=2", "b=3", "--json", *there, "--token-file", str(secret)]) == 0
        assert capsys.readouterr() == ('{"sum": 5}\n', "")
        assert main(["service", "list", *there, "--token-file", str(secret)]) == 0
        assert capsys.readouterr() == ("/add\n", "")
        assert call_main(["/add", *there]) == 1
        assert "--token-file" in capsys.readouterr().err
        monkeypatch.setenv("TASKRPC_TOKEN", "open sesame")
        assert main(["doctor", node.address]) == 0


@pytest.mark.real_time
def test_missing_remote_program_gets_a_hint_to_use_doctor(capsys):
    code = call_main(["/add", "--timeout", "0.1", "--connect", "127.0.0.1:9"])
    assert code == 4
    assert "hint: find out why: taskrpc doctor 127.0.0.1:9\n" in capsys.readouterr().err


def test_empty_token_file_is_refused(tmp_path, capsys):
    empty = tmp_path / "secret.txt"
    empty.touch(0o600)
    assert main(["service", "list", "--connect", "a:1", "--token-file", str(empty)]) == 1
    assert capsys.readouterr().err == f"--token-file {empty}: the file is empty\n"


def test_unknown_transport_is_refused_with_the_known_ones(capsys):
    assert main(["node", "list", "--transport", "carrier-pigeon"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("transport: expected 'tcp'")
    assert "got 'carrier-pigeon'" in error


def test_over_another_transport_the_place_is_a_router_and_not_a_program():
    remote = Remote("robot:7447", transport="zenoh")
    assert (remote.address, remote.addresses, remote.peers) == ("", [], ["robot:7447"])
