"""Tasks as they are printed, and what of others' texts reaches the terminal."""

from __future__ import annotations

import json

import srvgen
from taskrpc.cli.robot.task.view import aligned, as_object, details, status_line, table
from taskrpc.observe.texts import printable

TASK_INFO = srvgen.load("taskrpc_interfaces/msg/TaskInfo")


def info(**fields):
    return TASK_INFO(**{"task_id": 3, "task_type": "move", "target": "dock", **fields})


def test_texts_of_other_users_cannot_control_the_terminal():
    nasty = info(target="a\x1b[2Jb\n", client="\x07", message="x\ry", state="FAILED")
    assert all(printable(line) == line for line in [status_line(nasty), *details(nasty)])
    assert as_object(nasty)["target"] == "a\x1b[2Jb\n"


def test_an_instant_that_is_not_set_is_null():
    assert as_object(info())["ended"] is None


def test_any_result_of_a_custom_robot_is_shown():
    found = {"ok": True, "path": [[0, 1]], "name": "x\n", "many": list(range(20)), "none": None}
    lines = details(info(result=json.dumps(found), state="SUCCEEDED"))
    assert lines[-5:] == [
        "  ok:        true",
        "  path:      [[0, 1]]",
        '  name:      "x\\n"',
        "  many:      20 values from 0 to 19",
        "  none:      null",
    ]


def test_columns_are_aligned():
    assert aligned([("a", "bb"), ("100", "c")], right={0}) == ["  a  bb", "100  c"]


def test_table_has_a_column_for_robots_only_in_a_fleet():
    alone = info(state="QUEUED", priority=5)
    assert "robot" not in table([alone])[0]
    tasks = [
        info(state="RUNNING", priority=5, robot="robot_1"),
        info(state="QUEUED", priority=5, robot="robot_2"),
    ]
    heading, running, queued = table(tasks)
    assert heading.split()[4] == "robot"
    assert " robot_1 " in running
    assert " (robot_2) " in queued
    assert as_object(tasks[0])["robot"] == "robot_1"
    assert "  robot:     (robot_2)" in details(tasks[1])


def test_queued_task_shows_which_robot_it_waits_for_instead_of_a_time():
    waits = info(
        state="QUEUED", priority=5, robot="", message="waits for r2, which is away", task_id=1
    )
    other = info(state="QUEUED", priority=5, robot="r1")
    assert "waits for r2, which is away" in table([waits, other])[1]
    assert "0.0 s" not in table([waits, other])[1]
    assert status_line(waits).endswith("  QUEUED  waits for r2, which is away")
    assert not any("done in" in line for line in details(waits))
