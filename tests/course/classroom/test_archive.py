"""What remains of a group: a dated file with its students and tasks."""

import json
import os
import time
from pathlib import Path

import pytest

from taskrpc.course.classroom.archive import summary, write_archive
from taskrpc.course.classroom.attendance import Attendance
from taskrpc.course.classroom.register import Register
from taskrpc.robot.tasks.model import Task, TaskState

NOON = time.mktime((2026, 11, 23, 12, 0, 0, 0, 0, -1))


@pytest.fixture
def register(tmp_path):
    made = Register(tmp_path / "class")
    made.add(["ada", "José", "absent"], 1e12)
    attendance = Attendance(made.attendance_file, lambda: 99.0)
    for name in ("ada", "Jose"):
        attendance.call_began(type("Call", (), {"principal": name}))
    attendance.node_ended(None)
    return made


def test_archive_has_the_students_who_called_and_the_tasks(register):
    task = Task(
        task_id=1,
        task_type="move",
        target="dock",
        priority=5,
        arrival=1,
        submitted_at=7.0,
        state=TaskState.CANCELED,
    )
    path = write_archive(register, [task], NOON, "/robot2/robot_task")
    assert path == register.folder / "archive" / "2026-11-23_12-00-00.json"
    found = json.loads(path.read_text(encoding="utf-8"))
    assert (found["ended"], found["service"]) == (NOON, "/robot2/robot_task")
    assert found["students"] == [
        {"name": "ada", "account": "ada", "last_call": 99.0},
        {"name": "José", "account": "Jose", "last_call": 99.0},
    ]
    assert [(each["task_id"], each["state"]) for each in found["tasks"]] == [(1, "CANCELED")]
    if os.name == "posix":
        assert path.stat().st_mode & 0o077 == 0


def test_archive_of_a_group_has_its_own_students_after_the_next_group_got_accounts(tmp_path):
    register = Register(tmp_path / "class")
    register.add(["ada", "小明"], 1e12)
    attendance = Attendance(register.attendance_file, lambda: 99.0)
    for name in ("ada", "student1"):
        attendance.call_began(type("Call", (), {"principal": name}))
    attendance.node_ended(None)
    assert [each.name for each in register.renew(["小红"], 1e12)] == ["student2"]
    found = json.loads(write_archive(register, [], NOON).read_text(encoding="utf-8"))
    assert [each["name"] for each in found["students"]] == ["ada", "小明"]


def test_second_archive_of_the_same_second_has_a_name_of_its_own(register):
    paths = [write_archive(register, [], NOON) for _ in range(3)]
    assert [path.name for path in paths] == [
        "2026-11-23_12-00-00.json",
        "2026-11-23_12-00-00_2.json",
        "2026-11-23_12-00-00_3.json",
    ]


def test_group_without_calls_and_tasks_leaves_no_file(tmp_path):
    register = Register(tmp_path)
    assert write_archive(register, [], NOON) is None
    assert not (tmp_path / "archive").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((0, None), "the queue is empty and the robot is at its start; there was nothing to keep"),
        (
            (1, Path("a.json")),
            "the queue is empty and the robot is at its start; 1 task of the former group: a.json",
        ),
        (
            (2, Path("a.json"), "the robot failed: x"),
            "the queue is empty and the robot failed: x; 2 tasks of the former group: a.json",
        ),
    ],
)
def test_summary_is_one_sentence(arguments, text):
    assert summary(*arguments) == text
