"""The task server as users run it: a process, the commands around it, restarts and mistakes."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time

import pytest

from taskrpc.cli.call import main as call_main
from taskrpc.cli.main import main

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

POSIX = pytest.mark.skipif(os.name == "nt", reason="sends POSIX signals")
PATIENCE = 60
READY = "taskrpc-server ready: /robot_task [my_robot_interfaces/srv/RobotTask] at "

HOOVER = """
import asyncio
from taskrpc.robot import Plan, Pose

class Hoover:
    speed = 1.0
    task_types = ("clean",)

    def plan(self, task_type, target, start):
        return Plan(0.2, start)

    def pose(self):
        return Pose(0.0, 0.0, 0.0)

    async def execute(self, task_type, target, report):
        await asyncio.sleep(0.2)
        return {"dust": len(target)}

    def remaining(self):
        return 0.1

    def pause(self):
        pass

    resume = stop = pause
"""


class TaskServer:
    """A `taskrpc-server` process, started and ready."""

    def __init__(self, folder, *argv, says=READY):
        self.folder = folder
        began = time.monotonic()
        self.log = folder / f"server-{time.monotonic_ns()}.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "taskrpc.cli.robot.server.command_line", *map(str, argv)],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
            )
        self.wait_until_it_says(says)
        self.exit_limit = max(2.0, time.monotonic() - began)
        """Seconds that an exit may take: 2, or as long as the start on a machine that is busy."""
        self.address = self.text.partition(READY)[2].partition("\n")[0]

    def wait_until_it_says(self, words):
        ends = time.monotonic() + PATIENCE
        while words not in self.text:
            assert self.process.poll() is None, self.text
            assert time.monotonic() < ends, self.text
            time.sleep(0.02)

    @property
    def text(self):
        return self.log.read_text(encoding="utf-8")

    def end(self, number=signal.SIGTERM):
        """Send a signal; returns the exit code and how many seconds it took."""
        began = time.monotonic()
        self.process.send_signal(number)
        code = self.process.wait(PATIENCE)
        return code, time.monotonic() - began


@pytest.fixture
def start(tmp_path):
    with contextlib.ExitStack() as stack:

        def start(*argv):
            server = TaskServer(tmp_path, "--db", tmp_path / "tasks.db", *argv)
            stack.callback(server.process.wait)
            stack.callback(server.process.kill)
            return server

        yield start


@pytest.fixture
def task(capsys):
    """`taskrpc task` with these arguments: exit code, stdout, stderr."""

    def task(*argv):
        capsys.readouterr()
        code = main(["task", *map(str, argv)])
        return code, *capsys.readouterr()

    return task


@pytest.fixture
def listed(task):
    """What `taskrpc task list --json` has."""

    def listed(*argv):
        code, out, err = task("list", "--json", *argv)
        assert code == 0, err
        return json.loads(out)

    return listed


def ids(tasks):
    return [each["task_id"] for each in tasks]


def wait_for_line(process, words):
    """Read a process's stderr up to a line with these words."""
    for line in process.stderr:
        if words in line:
            return
    pytest.fail(f"the process ended with {process.wait(PATIENCE)} and did not print {words!r}")


def wait_until_running(listed):
    ends = time.monotonic() + PATIENCE
    while (first := listed()[0])["state"] != "RUNNING":
        assert time.monotonic() < ends, first


def failing_server(folder, *argv):
    """A server that cannot start: exit code and stderr."""
    ended = subprocess.run(
        [sys.executable, "-m", "taskrpc.cli.robot.server.command_line", *map(str, argv)],
        cwd=folder, capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert "Traceback" not in ended.stderr
    return ended.returncode, ended.stderr


# The lecture


def test_lectures_four_tasks_run_in_the_order_two_one_three_four(start, task, listed):
    start("--speed", 50, "--settle", 1)
    code, out, err = task("submit", "move", "warehouse", 8)
    assert (code, err) == (0, "")
    assert out.startswith("Task queued: move (task 1, done in ")
    for argv in (("scan", "area_a", 9), ("move", "station_1", 5)):
        task("submit", *argv)
    assert ids(listed()) == [2, 1, 3]
    code, out, _ = task("submit", "report", "central", 3, "--wait")
    assert (code, out) == (0, "task 4  report central  priority 3  SUCCEEDED\n")
    ended = listed("--all")
    assert [each["state"] for each in ended] == ["SUCCEEDED"] * 4
    assert ids(sorted(ended, key=lambda each: each["started"])) == [2, 1, 3, 4]


def test_four_concurrent_clients_are_served(start, task, listed, tmp_path):
    start()
    task("pause")
    rows = [("move", "warehouse"), ("scan", "area_a"), ("move", "station_1"), ("report", "central")]
    clients = [
        subprocess.Popen(
            [sys.executable, "-m", "taskrpc.cli.call", "/robot_task", f"task_type={kind}",
             f"target={target}", "priority=5", "--json"],
            cwd=tmp_path, stdout=subprocess.PIPE,
        )
        for kind, target in rows
    ]  # fmt: skip
    answers = [json.loads(client.communicate(timeout=PATIENCE)[0]) for client in clients]
    assert sorted(answer["task_id"] for answer in answers) == [1, 2, 3, 4]
    assert all(answer["success"] and answer["estimated_time"] > 0 for answer in answers)
    found = {each["task_id"]: (each["task_type"], each["target"]) for each in listed()}
    assert [found[answer["task_id"]] for answer in answers] == rows


def test_plain_service_call_queues_a_task(start, capsys):
    start("--speed", 20)
    yaml = "{task_type: move, target: '3,3', priority: 7}"
    for number, request in enumerate(
        (
            ["my_robot_interfaces/srv/RobotTask", yaml],
            ["{task_type: move, target: 3 3, priority: 7}"],
            ["task_type=move", "target=3,3", "priority=7"],
        ),
        1,
    ):
        assert call_main(["/robot_task", *request]) == 0
        answer = f"RobotTask_Response(success=True, message='Task queued: move', task_id={number}, "
        assert answer in capsys.readouterr().out


def test_request_repeated_after_a_crash_moves_the_robot_once(start, listed, capsys):
    server = start("--settle", "60")
    request = ["task_type=move", "target=3,4", "priority=8", "--request-id", "monday", "--json"]
    answers = []
    for _ in range(2):
        assert call_main(["/robot_task", *request]) == 0
        answers.append(capsys.readouterr().out)
        server.process.kill()
        server.process.wait()
        server = start("--settle", "60")
    assert answers[0] == answers[1]
    assert ids(listed("--all")) == [1]
    request[1] = "target=1,1"
    assert call_main(["/robot_task", *request]) == 1
    assert "another request was sent under this request id" in capsys.readouterr().err


def test_refused_task_has_a_reason_and_uses_no_id(start, capsys):
    start("--speed", 20)
    for kind, target, priority, message in (
        ("fly", "dock", 5, "Invalid task: fly (expected move, scan or report)"),
        ("move", "moon", 5, "Invalid target: unknown target 'moon'"),
        ("move", "99,1", 5, "Invalid target: target '99,1' is outside the map"),
        ("move", "dock", 0, "Invalid priority: 0 (expected 1 to 10"),
        ("move", "dock", 11, "Invalid priority: 11 (expected 1 to 10"),
    ):
        values = f"task_type={kind}", f"target={target}", f"priority={priority}"
        assert call_main(["/robot_task", *values, "--json"]) == 0
        refused = json.loads(capsys.readouterr().out)
        assert refused["message"].startswith(message)
        del refused["message"]
        assert refused == {"success": False, "task_id": -1, "estimated_time": 0.0}
    call_main(["/robot_task", "task_type=report", "target=dock", "priority=5", "--json"])
    assert json.loads(capsys.readouterr().out)["task_id"] == 1


def test_full_queue_refuses_tasks_until_there_is_room(start, task):
    start("--queue-limit", 1, "--speed", 20)
    task("pause")
    assert task("submit", "move", "dock")[0] == 0
    code, out, err = task("submit", "move", "dock")
    assert (code, out, err) == (1, "", "Queue full (waiting: 1, limit: 1)\n")
    task("drop", 1)
    assert task("submit", "move", "dock")[1].startswith(
        "Task queued: move (the queue is paused) (task 2, "
    )


# The commands


def test_tasks_are_cancelled_moved_dropped_and_queued_again(start, task, listed):
    start("--speed", 20)
    assert task("pause")[:2] == (0, "The queue is paused\n")
    for target, priority in (("warehouse", 3), ("station_1", 5), ("dock", 7)):
        task("submit", "move", target, priority)
    assert ids(listed()) == [3, 2, 1]
    assert task("reprioritise", 1, 10)[1].startswith("Task 1 has priority 10")
    assert ids(listed()) == [1, 3, 2]
    assert task("cancel", 3)[:2] == (0, "Task 3 was cancelled\n")
    assert task("drop", 2)[:2] == (0, "Task 2 was cancelled\n")
    assert task("requeue", 3)[0] == 0
    assert ids(listed()) == [1, 3]
    assert task("resume")[:2] == (0, "The queue is resumed\n")
    code, out, _ = task("submit", "report", "dock", 1, "--wait", "--json")
    assert code == 0
    assert json.loads(out)["result"].keys() == {"pose", "battery", "odometer"}
    assert task("cancel", 1)[0] == 1
    assert "only an interrupted, failed or cancelled task" in task("requeue", 1)[2]
    assert task("requeue", 99) == (1, "", "There is no task 99\n")


def test_stop_halts_the_robot_and_ends_a_waiting_submit_with_an_error(start, task, tmp_path):
    start("--speed", 1)
    waiting = subprocess.Popen(
        [sys.executable, "-m", "taskrpc", "task", "submit", "move", "warehouse", "--wait"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wait_for_line(waiting, "RUNNING")
    code, out, _ = task("stop")
    assert code == 0
    assert out.startswith("The robot is stopped and the queue is paused; task 1 was cancelled")
    out, _ = waiting.communicate(timeout=PATIENCE)
    assert waiting.returncode == 1
    assert out.startswith("task 1  move warehouse  priority 5  CANCELED")


@POSIX
def test_ctrl_c_does_not_cancel_the_task_and_reports_it(start, task, tmp_path):
    start("--speed", 1)
    waiting = subprocess.Popen(
        [sys.executable, "-m", "taskrpc", "task", "submit", "move", "warehouse", "--wait"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wait_for_line(waiting, "RUNNING")
    waiting.send_signal(signal.SIGINT)
    out, err = waiting.communicate(timeout=PATIENCE)
    assert (waiting.returncode, out) == (130, "")
    assert err == "task 1 continues; to cancel it: taskrpc task cancel 1\n"
    assert "RUNNING" in task("list")[1]


@POSIX
def test_server_exits_with_130_after_ctrl_c_and_drain(start):
    server = start("--speed", 20)
    assert server.end(signal.SIGINT)[0] == 130


def test_exit_code_without_a_server_is_4_with_a_hint(task):
    code, out, err = task("list", "--timeout", 0.2)
    assert (code, out) == (4, "")
    assert "no server offers /robot_task (waited 0.2 s)" in err
    assert "start one, for example taskrpc-server" in err
    code, _, err = task("list", "--timeout", 0.2, "--json")
    assert (code, json.loads(err)["error"]) == (4, "ServiceUnavailable")


def test_server_is_reached_by_its_address(start, task):
    server = start("--speed", 20)
    assert task("submit", "report", "dock", "--connect", server.address)[0] == 0


# Start, restart and end


@POSIX
def test_restart_keeps_the_queue_and_reports_interrupted_tasks(start, task, listed):
    first = start("--speed", 1)
    for target, priority in (("warehouse", 9), ("station_1", 2), ("dock", 5)):
        task("submit", "move", target, priority)
    wait_until_running(listed)
    code, seconds = first.end()
    assert code == 0
    assert seconds < first.exit_limit
    # The new robot stands at the dock: without the settle time, task 3 might end before the list.
    second = start("--speed", 1, "--settle", PATIENCE)
    assert "taskrpc-server: resumed 2 queued tasks; task 1 was interrupted" in second.text
    assert "taskrpc task resume 1, requeue 1 or drop 1" in second.text
    assert second.text.index("resumed") < second.text.index(READY)
    assert ids(listed()) == [3, 2]
    (interrupted,) = [each for each in listed("--all") if each["task_id"] == 1]
    assert interrupted["state"] == "INTERRUPTED"
    assert task("resume", 1)[0] == 0
    assert 1 in ids(listed())
    assert task("submit", "move", "dock")[1].startswith("Task queued: move (task 4, ")


@POSIX
def test_killed_server_loses_no_task(start, task, listed):
    first = start("--speed", 1)
    task("submit", "move", "warehouse", 9)
    task("submit", "move", "station_1", 2)
    wait_until_running(listed)
    first.end(signal.SIGKILL)
    second = start("--speed", 1, "--settle", PATIENCE)
    assert "resumed 1 queued task; task 1 was interrupted" in second.text
    assert ids(listed()) == [2]


@POSIX
def test_watchers_do_not_delay_the_servers_exit(start, tmp_path):
    server = start()
    watching = subprocess.Popen(
        [sys.executable, "-m", "taskrpc", "task", "watch"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert watching.stderr is not None
    main(["task", "pause"])
    assert watching.stdout is not None
    assert watching.stdout.readline().endswith("the queue is paused\n")
    code, seconds = server.end()
    assert code == 0
    assert seconds < server.exit_limit
    assert "waiting for its next start" in watching.stderr.readline()
    start()
    assert watching.stderr.readline() == "the task server is back\n"
    watching.send_signal(signal.SIGINT)
    watching.communicate(timeout=PATIENCE)
    assert watching.returncode == 130


def test_fresh_forgets_earlier_tasks(start, task, listed):
    server = start("--speed", 1)
    task("submit", "move", "warehouse")
    server.end()
    start("--fresh")
    assert listed("--all") == []
    assert task("submit", "move", "dock")[1].startswith("Task queued: move (task 1, ")


# Mistakes


def test_second_server_with_the_same_name_is_refused(start, tmp_path):
    first = start()
    code, err = failing_server(tmp_path, "--db", ":memory:")
    assert code == 1
    assert "/robot_task" in err
    assert str(first.process.pid) in err


def test_used_port_is_named_in_the_error(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        code, err = failing_server(tmp_path, "--db", ":memory:", "--listen", f"127.0.0.1:{port}")
    assert code == 1
    assert f"127.0.0.1:{port}" in err


def test_users_robot_replaces_the_simulated_robot(start, task, tmp_path):
    (tmp_path / "my_robot.py").write_text(HOOVER, encoding="utf-8")
    start("--robot", "my_robot:Hoover")
    code, out, _ = task("submit", "clean", "kitchen", 5, "--wait", "--json")
    assert (code, json.loads(out)["result"]) == (0, {"dust": 7})
    assert task("submit", "move", "dock")[2].startswith("Invalid task: move (expected clean)")


# The demo


# A busy machine lets the demo wait for the processor, and then its timers are late. This clock
# leaves out that time: it counts the timeouts of `select`, and the processor time of callbacks.
DEMO_ON_A_BUSY_MACHINE = """
import asyncio, selectors, sys, time
from taskrpc.cli.main import main

class Selector(selectors.DefaultSelector):
    callbacks_began, waited_for_processor = None, 0.0

    def select(self, timeout=None):
        began = time.monotonic()
        if self.callbacks_began:
            wall, cpu = self.callbacks_began
            self.waited_for_processor += began - wall - (time.thread_time() - cpu)
        events = super().select(timeout)
        ended = time.monotonic()
        if timeout and timeout > 0:
            self.waited_for_processor += max(0.0, ended - began - timeout)
        self.callbacks_began = ended, time.thread_time()
        return events

class Loop(asyncio.SelectorEventLoop):
    def __init__(self):
        self.selector = Selector()
        super().__init__(self.selector)

    def time(self):
        return super().time() - self.selector.waited_for_processor

def run(main):
    with asyncio.Runner(loop_factory=Loop) as runner:
        return runner.run(main)

asyncio.run = run
sys.exit(main(["demo", *sys.argv[1:]]))
"""


def test_demo_ends_with_right_estimates_beside_a_running_server(start, listed, tmp_path):
    start()
    ended = subprocess.run(
        [sys.executable, "-c", DEMO_ON_A_BUSY_MACHINE, "--speed", "20"],
        cwd=tmp_path, capture_output=True, timeout=PATIENCE, check=False,
        env={**os.environ, "PYTHONIOENCODING": "cp1252"},
    )  # fmt: skip
    out = ended.stdout.decode("cp1252")
    assert (ended.returncode, ended.stderr) == (0, b""), out
    assert re.search(r"Task \d is off most, by [+-]\d+\.\d+ %", out)
    assert "\x1b" not in out
    assert listed("--all") == []


@POSIX
def test_ctrl_c_ends_the_demo_without_a_traceback(tmp_path):
    running = subprocess.Popen(
        [sys.executable, "-m", "taskrpc", "demo"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert running.stdout is not None
    running.stdout.readline()
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=PATIENCE)
    assert (running.returncode, err) == (130, b"")


@POSIX
def test_demo_draws_on_a_terminal_and_restores_it(tmp_path):
    import fcntl
    import pty
    import struct
    import termios

    leader, follower = pty.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    running = subprocess.Popen(
        [sys.executable, "-m", "taskrpc", "demo", "--speed", "20"],
        cwd=tmp_path, stdin=follower, stdout=follower, stderr=follower,
        env={**os.environ, "TERM": "xterm-256color", "PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    os.close(follower)
    drawn = b""
    with contextlib.suppress(OSError):  # on Linux the leader's end of file is an error
        while chunk := os.read(leader, 65536):
            drawn += chunk
    os.close(leader)
    # The exit code is 1 on a busy machine, whose timers are late; this test is about drawing.
    assert running.wait(PATIENCE) in (0, 1), drawn[-2000:]
    text = drawn.decode()
    before, _, after = text.rpartition("\x1b[?1049l")
    assert "task server: priority queue" in before
    assert re.search(r"Task \d is off most, by [+-]\d+\.\d+ %|estimates were wrong by more", after)
    assert "taskrpc-server" in after
