"""`taskrpc doctor` reports each problem with its cause and with advice."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading

import pytest

from taskrpc.cli.main import main
from taskrpc.cli.ros.doctor import probe
from tests.raw_servers import served

pytestmark = pytest.mark.real_time


@pytest.fixture
def examine(capsys):
    """Runs the doctor: exit code and the findings that are not `ok`, as (state, text, advice)."""

    def _examine(*argv):
        code = main(["doctor", *argv, "--json"])
        found = json.loads(capsys.readouterr().out)
        return code, [tuple(one.values()) for one in found if one["state"] != "ok"]

    return _examine


def test_no_problems_are_reported_while_a_server_runs(server, capsys):
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert f"adder.py (pid {server.process.pid}, in {server.folder}) at {server.address}" in out
    assert out.endswith("no problems\n")
    assert all(line.startswith(("ok ", "no problems")) for line in out.splitlines())


def test_each_step_to_a_working_server_is_reported(server, examine, capsys):
    assert examine(server.address) == (0, [])
    main(["doctor", server.address])
    out = capsys.readouterr().out
    assert f"{server.address} offers /" in out


def test_missing_server_is_a_note_and_no_problem(examine):
    code, ((state, text, advice),) = examine()
    assert (code, state) == (0, "note")
    assert text == "no program of this machine offers a service in domain 0"
    assert "taskrpc-server" in advice


def test_services_of_another_domain_are_noted(server, examine, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "9")
    code, found = examine()
    assert code == 0
    assert found[-1][1].startswith("in domain 0 there are /add_two_ints")
    assert found[-1][2] == "set ROS_DOMAIN_ID=0 to call them"


def only_problem(result) -> tuple[str, str]:
    code, found = result
    problems = [one[1:] for one in found if one[0] == "problem"]
    assert code == 1
    assert len(problems) == 1, problems
    return problems[0]


def test_server_of_another_domain_is_a_problem(server, examine, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "9")
    text, advice = only_problem(examine(server.address))
    assert "domain 0" in text
    assert "ROS_DOMAIN_ID" in advice


def test_missing_token_is_a_problem(session_server, examine):
    text, advice = only_problem(examine(session_server.address))
    assert "its secret is needed" in text
    assert "--token-file" in advice


def test_port_without_a_program_is_a_problem(examine):
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    text, advice = only_problem(examine(f"127.0.0.1:{port}"))
    assert text == f"no program listens at 127.0.0.1 port {port}"
    assert f"--listen HOST:{port}" in advice


def test_foreign_program_at_the_port_is_a_problem(examine):
    with served(socket.create_server(("127.0.0.1", 0)), _answer_as_a_web_server) as place:
        text, advice = only_problem(examine(place))
    assert text.startswith(f"{place}: ")
    assert "another program than taskrpc" in advice


def _answer_as_a_web_server(connection: socket.socket) -> None:
    connection.recv(4096)
    connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")


def test_unknown_host_name_is_a_problem(examine, monkeypatch):
    def unknown(*args, **options):
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr("socket.getaddrinfo", unknown)
    text, advice = only_problem(examine("robot.invalid:7450"))
    assert text == "the name robot.invalid is unknown: Name or service not known"
    assert "spelling" in advice


async def test_resolver_without_an_answer_times_out(monkeypatch):
    answer = threading.Event()
    monkeypatch.setattr("socket.getaddrinfo", lambda *args, **options: [answer.wait(10)][:0])
    with pytest.raises(TimeoutError, match=r"no response within 0\.05 s"):
        await probe.resolve("robot", 1, 0.05)
    answer.set()


def test_host_that_does_not_answer_gets_advice_about_firewalls(examine, monkeypatch):
    async def hang(*args, **options):
        raise TimeoutError

    monkeypatch.setattr("asyncio.open_connection", hang)
    text, advice = only_problem(examine("192.0.2.1:7450"))
    assert "192.0.2.1 did not respond at port 7450" in text
    assert "firewall" in advice


def test_invalid_domain_is_a_problem(examine, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    code, found = examine()
    assert code == 1
    assert found[0][1] == "ROS_DOMAIN_ID: expected a number from 0 to 232, got 'many'"


def test_unusable_runtime_folder_is_a_problem(examine, monkeypatch, tmp_path):
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(file))
    code, found = examine()
    assert code == 1
    assert "the folder in which programs find each other" in found[0][1]
    assert "XDG_RUNTIME_DIR" in found[0][2]


def test_missing_folder_in_the_interface_path_is_a_problem(examine, monkeypatch, tmp_path):
    monkeypatch.setenv("TASKRPC_INTERFACE_PATH", os.pathsep.join([str(tmp_path), "/not/there"]))
    text, _ = only_problem(examine())
    assert text == "TASKRPC_INTERFACE_PATH: expected folders of packages, got /not/there"


def test_definition_that_differs_from_the_server_is_a_problem(
    server, examine, monkeypatch, tmp_path
):
    folder = tmp_path / "example_interfaces" / "srv"
    folder.mkdir(parents=True)
    (folder / "AddTwoInts.srv").write_text("int64 a\nint64 b\nint64 c\n---\nint64 sum\n")
    monkeypatch.chdir(tmp_path)
    text, advice = only_problem(examine())
    assert "adder.py has another definition of example_interfaces/srv/AddTwoInts" in text
    assert "compare the .srv files" in advice


def test_invalid_address_is_wrong_usage(capsys):
    assert main(["doctor", "robot"]) == 2
    assert "expected HOST:PORT such as 127.0.0.1:7450, got 'robot'" in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="Windows cannot stop a process")
def test_server_stopped_by_ctrl_z_is_reported_with_the_command_that_continues_it(
    own_server, examine, monkeypatch
):
    monkeypatch.setattr("taskrpc.core.transport.connection.connection.HANDSHAKE_TIMEOUT", 0.3)
    monkeypatch.setattr(probe, "STEP_TIMEOUT", 0.6)
    pid = own_server.process.pid
    os.kill(pid, signal.SIGSTOP)
    os.waitpid(pid, os.WUNTRACED)
    text, advice = only_problem(examine())
    assert text.endswith(
        f"(pid {pid}, in {own_server.folder}) does not answer: it is stopped, as by Ctrl-Z"
    )
    assert f"kill -CONT {pid}" in advice
    code, found = examine(own_server.address)
    assert (code, len(found)) == (1, 2)
    assert found[1][1].endswith(f"(pid {pid}) is stopped, as by Ctrl-Z")
    assert f"`kill -CONT {pid}` continues it" in found[1][2]


def test_the_profile_of_keepalive_is_noted_and_a_wrong_one_is_a_problem(examine, monkeypatch):
    monkeypatch.setenv("TASKRPC_KEEPALIVE", "robot")
    code, found = examine()
    note = "TASKRPC_KEEPALIVE is set: silent machines count as lost after 2 s"
    assert (code, found[0]) == (0, ("note", note, ""))
    monkeypatch.setenv("TASKRPC_KEEPALIVE", "fast")
    code, ((_, text, advice), *_) = examine()
    assert (code, text) == (1, "TASKRPC_KEEPALIVE: expected default or robot, got 'fast'")
    assert "set it" in advice
