"""A class: the lecturer creates it; a laptop joins with one line, calls, and is revoked."""

from __future__ import annotations

import json
import os
import re
import socket
import ssl
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

PATIENCE = 60
ROOT = Path(__file__).parents[2]


class Machine:
    """A computer with state and runtime folders of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        for name in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
            place = folder / name
            place.mkdir(parents=True, mode=0o700)
            self.environment[name] = str(place)

    def command(self, *argv):
        module = "taskrpc.cli.call" if argv[0] == "taskrpc-call" else "taskrpc"
        return [sys.executable, "-m", module, *argv[1:]]

    def run(self, *argv, code=0):
        ended = subprocess.run(
            self.command(*argv),
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        assert "Traceback" not in ended.stderr, ended.stderr
        assert code in (None, ended.returncode), ended.stdout + ended.stderr
        return ended.stdout + ended.stderr if ended.returncode else ended.stdout


@pytest.fixture(scope="module")
def lecturer(tmp_path_factory):
    return Machine(tmp_path_factory.mktemp("lecturer"))


@pytest.fixture(scope="module")
def strings(lecturer):
    """The join strings of two students, by name."""
    import cryptography  # noqa: F401 — the tests are skipped where it cannot be loaded

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    (lecturer.folder / "names.txt").write_text("ada\ngrace\n\n", encoding="utf-8")
    where = "--address", "127.0.0.1", "--port", port
    said = lecturer.run("taskrpc", "classroom", *where, "--students", "names.txt")
    serving = *where, "--share", "2", "--web", "0.0.0.0:0", "--serve", "--db", ":memory:"
    server = subprocess.Popen(
        lecturer.command("taskrpc", "classroom", *serving),
        cwd=lecturer.folder,
        env=lecturer.environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert any("ready" in line for line in server.stderr)
        yield dict(line.split() for line in said.splitlines())
    finally:
        server.terminate()
        server.communicate(timeout=PATIENCE)


@pytest.fixture
def laptop(tmp_path):
    return Machine(tmp_path / "laptop")


def submit(laptop, timeout=PATIENCE, **options):
    argv = "task_type=move", "target=station_1", "priority=5", "--timeout", str(timeout)
    return laptop.run("taskrpc-call", "/robot_task", *argv, "--json", **options)


def roster(lecturer):
    return {
        row["name"]: row
        for row in json.loads(lecturer.run("taskrpc", "classroom", "roster", "--json"))
    }


def test_laptop_joins_calls_and_is_revoked(lecturer, strings, laptop):
    said = laptop.run("taskrpc", "join", strings["ada"])
    assert re.search(r"joined the lab at 127\.0\.0\.1:\d+ as ada, until \d{4}-", said)
    assert "/robot_task" in said
    assert roster(lecturer)["ada"]["state"] == "joined"
    assert roster(lecturer)["grace"]["state"] == "invited"
    assert "/robot_task\n" in laptop.run("taskrpc", "service", "list")
    assert "/ada" in laptop.run("taskrpc", "join", "--status")
    laptop.environment["TASKRPC_PEERS"] = "192.0.2.1:1"
    assert "TASKRPC_PEERS is set" in laptop.run("taskrpc", "join", "--status")
    del laptop.environment["TASKRPC_PEERS"]

    lecturer.run("taskrpc", "task", "pause")
    for _ in range(2):
        assert json.loads(submit(laptop))["success"]
    refused = json.loads(submit(laptop))
    assert refused["message"] == "Share full: ada (waiting: 2, limit for one account: 2)"
    listed = json.loads(laptop.run("taskrpc", "task", "list", "--json"))
    assert len(listed) == 2
    row = roster(lecturer)["ada"]
    assert row["waiting"] == 2
    assert time.time() - row["last_call"] < PATIENCE

    lecturer.run("taskrpc", "classroom", "revoke", "ada")
    deadline = time.monotonic() + PATIENCE
    while "refuses the account" not in laptop.run("taskrpc", "join", "--status", code=None):
        assert time.monotonic() < deadline
    assert "token" in submit(laptop, code=1)
    assert "revoked" in laptop.run("taskrpc", "join", strings["ada"], code=1)
    assert roster(lecturer)["ada"]["state"] == "revoked"
    assert "the account may be revoked or" in laptop.run("taskrpc", "doctor", code=1)

    laptop.run("taskrpc", "join", "--leave")
    assert "no server offers" in submit(laptop, timeout=0.5, code=4)


def test_laptop_opens_the_page_of_the_lab_with_its_own_account(strings, laptop):
    laptop.run("taskrpc", "join", strings["grace"])
    said = laptop.run("taskrpc", "view")
    link, token = re.findall(r"look: +(https://127\.0\.0\.1:\d+/)#view=(grace\..+)", said)[0]
    assert f"{link}?projector#view={token}" in said
    trusting = ssl._create_unverified_context()
    asked = urllib.request.Request(f"{link}live", headers={"Authorization": f"Bearer {token}"})
    with urllib.request.urlopen(asked, context=trusting, timeout=PATIENCE) as events:
        assert events.readline() == b"event: hello\n"
        assert json.loads(events.readline().removeprefix(b"data: "))["control"] is True
    # It has started no server, which would get the laptop's calls.
    assert len(laptop.run("taskrpc", "ps").splitlines()) == 1


def test_mistyped_invitation_is_refused_and_changes_nothing(strings, laptop):
    right = strings["grace"]
    wrong = right[:30] + ("A" if right[30] != "A" else "B") + right[31:]
    assert "the character at position 31" in laptop.run("taskrpc", "join", wrong, code=1)
    assert "you have not joined a lab" in laptop.run("taskrpc", "join", "--status", code=1)


PROGRAM = """
import asyncio, srvgen, taskrpc

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
Trigger = srvgen.load("std_srvs/srv/Trigger")

def greet(request, response):
    response.success = True
    return response

async def main():
    async with taskrpc.Node("turtle") as node:
        node.create_service(Trigger, "greet", greet)
        robot = node.create_client(RobotTask, "robot_task")
        asked = RobotTask.Request(task_type="report", target="dock", priority=5)
        answer = await robot.call(asked)
        print(answer.success, answer.task_id > 0, node.get_fully_qualified_name(), flush=True)
        await node.spin()

taskrpc.run(main())
"""


def test_unchanged_programs_call_the_lab_in_their_own_namespace(strings, laptop):
    said = laptop.run("taskrpc", "join", strings["grace"])
    assert "Your own services are in /grace: `greet` is /grace/greet." in said
    script = laptop.folder / "turtle.py"
    script.write_text(PROGRAM, encoding="utf-8")
    for argv, services in (
        ([sys.executable, str(script)], ["/grace/greet", "/robot_task"]),
        (
            [sys.executable, "-m", "taskrpc.cli.robot.server.command_line", "--db", ":memory:"],
            ["/robot_task"],
        ),
    ):
        own = subprocess.Popen(
            argv,
            cwd=laptop.folder,
            env=laptop.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            line = next(each for each in own.stdout if "ready:" in each or "turtle" in each)
            assert "/grace/robot_task" not in line
            assert "ready: /robot_task" in line or line == "True True /grace/turtle\n"
            listed = laptop.run("taskrpc", "service", "list").splitlines()
            assert [each for each in listed if each.count("/") == 1 or "greet" in each] == services
        finally:
            own.terminate()
            own.communicate(timeout=PATIENCE)
