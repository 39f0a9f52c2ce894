"""`taskrpc-server --record`: a process that records its run, ends, or is killed."""

from __future__ import annotations

import contextlib
import signal

import pytest

from taskrpc.cli.call import main as call
from taskrpc.cli.main import main
from taskrpc.observe.recording.mcap_file import Recording
from taskrpc.observe.recording.replay import replay
from taskrpc.observe.recording.timeline import Timeline
from tests.end_to_end.test_robot_task import HOOVER, POSIX, TaskServer

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time, POSIX]


@pytest.fixture
def start(tmp_path):
    with contextlib.ExitStack() as stack:

        def start(*argv):
            server = TaskServer(tmp_path, "--db", ":memory:", *argv)
            stack.callback(server.process.wait)
            stack.callback(server.process.kill)
            return server

        yield start


def submit(server, capsys, *fields):
    assert call(["/robot_task", *fields, "--connect", server.address]) == 0
    capsys.readouterr()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_recorded_run_replays_with_the_same_decisions(start, tmp_path, capsys, number):
    server = start("--record", "run.mcap", "--speed", "50")
    assert "taskrpc-server: recording to run.mcap\n" in server.text
    for target, priority in ("warehouse", 5), ("central", 5), ("station_1", 9):
        fields = f"task_type=scan target={target} priority={priority}".split()
        submit(server, capsys, *fields)
    server.wait_until_it_says("Task 2 completed")
    server.end(number)
    recording = Recording(tmp_path / "run.mcap")
    report = replay(recording)
    assert report.differences == []
    assert report.events > 40
    assert bool(recording.problem) is (number == signal.SIGKILL)
    shown = Timeline(recording).state_at(float("inf"))["tasks"].data
    assert shown["counts"]["SUCCEEDED"] == 3  # each change is written at once
    assert main(["bag", "info", str(recording.path)]) == 0
    out, err = capsys.readouterr()
    assert "Service: /robot_task | Type: my_robot_interfaces/srv/RobotTask | Event Count: 6" in out
    assert ("is not finished" in err) is (number == signal.SIGKILL)


def test_run_of_a_robot_class_of_ones_own_is_recorded(start, tmp_path, capsys):
    (tmp_path / "hoover.py").write_text(HOOVER, encoding="utf-8")
    server = start("--record", "run.mcap", "--robot", "hoover:Hoover")
    submit(server, capsys, "task_type=clean", "target=room", "priority=5")
    server.wait_until_it_says("Task 1 completed")
    server.end()
    report = replay(Recording(tmp_path / "run.mcap"))
    assert report.differences == []
    assert report.events > 5


def test_existing_file_is_kept(tmp_path, capsys, monkeypatch):
    from taskrpc.cli.robot.server.command_line import main as server

    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.mcap").write_text("precious")
    assert server(["--record", "run.mcap", "--db", ":memory:"]) == 1
    assert "cannot record to run.mcap: the file exists already" in capsys.readouterr().err
    assert (tmp_path / "run.mcap").read_text() == "precious"
