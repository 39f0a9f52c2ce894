"""A standby server continues where the previous server ended, also after a crash."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import urllib.request

import pytest

from taskrpc.cli.main import main
from taskrpc.cli.robot.server.command_line import main as server_main
from taskrpc.core.transport.tcp.tcp_network import listening_socket
from tests.end_to_end.test_robot_task import READY, TaskServer

pytestmark = [
    pytest.mark.end_to_end,
    pytest.mark.real_time,
    pytest.mark.skipif(os.name == "nt", reason="sends POSIX signals"),
]
STANDS_BY = "taskrpc-server: standing by: "


@pytest.fixture
def start(tmp_path):
    with contextlib.ExitStack() as stack:

        def start(*argv, says=READY):
            argv = ("--db", tmp_path / "tasks.db", *argv)
            server = TaskServer(tmp_path, *argv, says=says)
            stack.callback(server.process.wait)
            stack.callback(server.process.kill)
            return server

        yield start


def free_place():
    with contextlib.closing(listening_socket("127.0.0.1", 0)) as sock:
        return f"127.0.0.1:{sock.getsockname()[1]}"


def submit(*targets):
    for target in targets:
        assert main(["task", "submit", "move", target, "5"]) == 0


def listed(capsys):
    capsys.readouterr()
    assert main(["task", "list", "--json", "--all"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("name", ["SIGTERM", pytest.param("SIGKILL", marks=pytest.mark.faults)])
def test_standby_continues_the_tasks_at_the_same_addresses(start, capsys, name):
    number = signal.Signals[name]
    places = ("--listen", free_place(), "--web", free_place())
    first = start(*places)
    submit("warehouse", "station_1", "central")
    second = start(*places, "--standby", says=STANDS_BY)
    assert f"is in use by another task server (pid {first.process.pid}, since " in second.text
    assert READY not in second.text
    code, _ = first.end(number)
    assert code == (0 if number == signal.SIGTERM else -number)
    second.wait_until_it_says(READY)
    assert f"{READY}{first.address}\n" in second.text
    assert "resumed 2 queued tasks; task 1 was interrupted" in second.text
    with urllib.request.urlopen(f"http://{places[-1]}/health") as answer:
        assert answer.status == 200
    tasks = {task["task_id"]: task["state"] for task in listed(capsys)}
    assert sorted(tasks) == [1, 2, 3]
    assert tasks[1] == "INTERRUPTED"
    assert second.end()[0] == 0


def test_standby_without_another_server_starts_at_once(start):
    only = start("--standby")
    assert "standing by" not in only.text


@pytest.mark.faults
def test_standby_can_be_stopped_without_effect_on_the_server(start, capsys):
    first = start()
    second = start("--standby", says=STANDS_BY)
    code, seconds = second.end()
    assert (code, second.text.count("\n")) == (0, 1)
    assert seconds < second.exit_limit
    submit("warehouse")
    assert len(listed(capsys)) == 1
    assert first.end()[0] == 0


@pytest.mark.faults
def test_one_of_two_standbys_takes_over_and_the_other_waits(start):
    first = start()
    others = [start("--standby", says=STANDS_BY) for _ in range(2)]
    first.end()
    while not (ready := [each for each in others if READY in each.text]):
        assert all(each.process.poll() is None for each in others)
    (other,) = set(others) - set(ready)
    assert READY not in other.text
    ready[0].end()
    other.wait_until_it_says(READY)


def test_standby_reports_a_name_that_stays_in_use(start, tmp_path, monkeypatch):
    first = start()
    monkeypatch.setattr("taskrpc.cli.robot.server.command_line._STANDBY_TIMEOUT", 0.2)
    assert server_main(["--db", str(tmp_path / "other.db"), "--standby"]) == 1
    assert first.process.poll() is None
