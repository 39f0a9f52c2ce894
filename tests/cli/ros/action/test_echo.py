"""`taskrpc action echo` prints the messages of the action's topics and services."""

from __future__ import annotations

import subprocess
import sys

import pytest

from taskrpc.cli.ros.action.echo import INTERFACES, chosen
from taskrpc.cli.shared.command import UsageError

pytestmark = pytest.mark.real_time


def test_interfaces_are_chosen_by_name():
    assert chosen(None) == list(INTERFACES)
    assert chosen("feedback_topic | STATUS_TOPIC") == ["FEEDBACK_TOPIC", "STATUS_TOPIC"]
    for text in ("", "FEEDBACK"):
        with pytest.raises(UsageError, match=r"expected GOAL_SERVICE, .*separated by"):
            chosen(text)


def test_an_action_without_a_type_is_an_error(action, run):
    code, _, err = run("action", "echo", "/fibonaci")
    assert (code, err) == (
        1,
        "Cannot find type for '/fibonaci'\n  hint: did you mean /fibonacci?\n",
    )


def test_feedback_and_status_are_printed(action, run):
    assert run("action", "send_goal", "/fibonacci", "order=1")[0] == 0
    command = [sys.executable, "-m", "taskrpc", "action", "echo", "/fibonacci", "--no-arr"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        # The status of the first goal is latched: the command subscribes from here on.
        assert process.stdout.readline() == "interface: STATUS_TOPIC\n"
        assert run("action", "send_goal", "/fibonacci", "order=2")[0] == 0
        lines = []
        while lines[-2:] != ["  sequence: '<sequence type: int32, length: 3>'\n", "---\n"]:
            lines.append(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()
    text = "".join(lines)
    assert "interface: FEEDBACK_TOPIC\ngoal_id:\n  uuid: '<array type: uint8[16]>'\n" in text
    assert "status_list: '<sequence type: action_msgs/msg/GoalStatus, length: " in text
