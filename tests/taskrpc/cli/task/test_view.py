"""Tasks as they are printed, and what of others' texts reaches the terminal."""

from __future__ import annotations

import json

import srvgen
from taskrpc.cli.task.view import aligned, as_object, details, printable, status_line

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
