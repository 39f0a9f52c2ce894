"""`taskrpc classroom reset`, while no server runs, and its questions."""

import argparse
import asyncio
import io
import json
import sys
from pathlib import Path

import pytest

from taskrpc.cli.course.classroom import command_line, reset
from taskrpc.cli.main import main
from taskrpc.cli.shared.task_database import default_database
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.course.classroom.attendance import Attendance, last_calls
from taskrpc.course.classroom.class_server import ClassServer
from taskrpc.course.classroom.register import Register
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore


@pytest.fixture
def register(monkeypatch):
    """The class of this user, with a student who called."""
    monkeypatch.setattr(reset, "REFRESH", 0.0)
    register = command_line._register()
    register.server = ClassServer(("192.0.2.7",), 7450)
    make_place(register)
    register.add(["ada"], 4e9)
    attendance = Attendance(register.attendance_file, lambda: 99.0)
    attendance.call_began(type("Call", (), {"principal": "ada"}))
    attendance.node_ended(None)
    return register


def make_place(register: Register) -> None:
    assert main(["classroom", "--address", "192.0.2.7"]) == 0
    register.revoke("class")


async def store(path, *tasks, paused=False):
    made = SqliteStore(path)
    await made.apply(tasks)
    await made.remember_pause(paused)
    await made.close()


async def stored(path):
    made = SqliteStore(path)
    found = await made.load()
    await made.close()
    return found


def make_task(number, state=TaskState.QUEUED):
    return Task(
        task_id=number,
        task_type="move",
        target="dock",
        priority=5,
        arrival=number,
        submitted_at=7.0,
        state=state,
    )


@pytest.mark.real_time
def test_reset_without_a_server_archives_the_stored_tasks(register, capsys):
    tasks = make_task(1, TaskState.SUCCEEDED), make_task(2, TaskState.RUNNING), make_task(3)
    asyncio.run(store(default_database(), *tasks, paused=True))
    capsys.readouterr()
    assert main(["classroom", "reset", "--yes"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("no server runs: the queue is empty and the robot is at its start; 3 ")
    archive = json.loads(Path(said.strip().rpartition(": ")[2]).read_bytes())
    assert [each["state"] for each in archive["tasks"]] == ["SUCCEEDED", "CANCELED", "CANCELED"]
    assert last_calls(register.attendance_file) == {}
    left = asyncio.run(stored(default_database()))
    assert (left.tasks, left.paused, left.next_id) == ((), False, 4)


def test_reset_without_any_tasks_keeps_the_last_calls_in_the_archive(register, capsys):
    assert main(["classroom", "reset", "--yes"]) == 0
    assert "; 0 tasks of the former group: " in capsys.readouterr().out
    assert main(["classroom", "reset", "--yes"]) == 0
    assert "there was nothing to keep" in capsys.readouterr().out


def test_new_accounts_print_new_strings_for_the_same_students(register, capsys):
    (before,) = [each for each in register.accounts() if each.name == "ada"]
    assert main(["classroom", "reset", "--yes", "--new-accounts"]) == 0
    (after,) = register.accounts()
    assert (after.name, after.secret != before.secret) == ("ada", True)
    assert "\ntaskrpc-join1." in capsys.readouterr().out


def test_students_of_the_next_group_replace_the_former_ones(register, tmp_path, capsys):
    (tmp_path / "names").write_text("zoe\nyara\n")
    assert main(["classroom", "reset", "--yes", "--students", str(tmp_path / "names")]) == 0
    assert [each.name for each in register.accounts()] == ["zoe", "yara"]
    assert "\nzoe taskrpc-join1." in capsys.readouterr().out


def test_reset_keeps_the_accounts_by_default(register):
    before = register.accounts()
    assert main(["classroom", "reset", "--yes"]) == 0
    assert register.accounts() == before


def test_script_must_say_yes(register, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(["classroom", "reset"]) == 2
    assert "expected --yes, because nobody can be asked here" in capsys.readouterr().err
    assert last_calls(register.attendance_file) == {"ada": 99.0}


@pytest.mark.parametrize(("answer", "code"), [("y", 0), ("YES", 0), ("", 1), ("no", 1)])
def test_on_a_terminal_the_command_asks(register, monkeypatch, capsys, answer, code):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda question: answer)
    assert main(["classroom", "reset"]) == code
    assert (last_calls(register.attendance_file) == {}) == (code == 0)
    assert ("nothing is changed" in capsys.readouterr().err) == (code == 1)


def test_reset_without_a_class_says_how_to_make_one(capsys):
    assert main(["classroom", "reset", "--yes"]) == 1
    assert "there is no class yet: `taskrpc classroom` makes one" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("services", "found"),
    [
        ([], []),
        (["/robot_task", "/robot_task/reset"], ["/robot_task/reset"]),
        (
            ["/robot_task/reset", "/robot2/robot_task/reset", "/arm/reset"],
            ["/robot2/robot_task/reset", "/robot_task/reset"],
        ),
    ],
)
def test_every_robot_of_the_class_is_reset(monkeypatch, services, found):
    offer(monkeypatch, services)
    assert reset._running() == found


def test_a_database_that_does_not_exist_is_named(register, capsys):
    assert main(["classroom", "reset", "--yes", "--db", "none.db"]) == 1
    assert (
        "--db: expected the database of the class, got none.db: no file" in capsys.readouterr().err
    )


def test_server_without_a_class_is_named(register, monkeypatch, capsys):
    offer(monkeypatch, ["/robot_task"])
    assert main(["classroom", "reset", "--yes"]) == 1
    said = capsys.readouterr().err
    assert "server.py (pid 77) is no server of a class" in said
    assert "taskrpc stop 77" in said


def offer(monkeypatch, services):
    endpoints = tuple(ServiceEndpoint(name, "t", "h", "n") for name in services)
    entry = RegistryEntry(77, "server.py", "/", 0.0, services=endpoints)
    monkeypatch.setattr(reset.suggestions, "others", lambda _: [entry])


def test_options_of_the_command(capsys):
    parser = argparse.ArgumentParser()
    command_line.configure(parser)
    given = parser.parse_args(["reset", "--yes", "--db", "a.db"])
    assert (given.yes, given.db, given.new_accounts) == (True, "a.db", False)
