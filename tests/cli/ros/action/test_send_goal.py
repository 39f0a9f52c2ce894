"""`taskrpc action send_goal` prints what ros2 prints, and cancels its goal on Ctrl-C."""

from __future__ import annotations

import io
import json
import re
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.real_time

TYPE = "example_interfaces/action/Fibonacci"
SENT = "Waiting for an action server to become available...\nSending goal:\n     order: {}\n\n"
ACCEPTED = "Goal accepted with ID: [0-9a-f]{32}\n\n"


def numbers(*sequence):
    return "    sequence:\n" + "".join(f"- {number}\n" for number in sequence) + "\n"


def test_a_goal_with_feedback(action, run):
    code, out, err = run("action", "send_goal", "-f", "/fibonacci", TYPE, "{order: 3}")
    assert (code, err) == (0, "")
    feedback = f"Feedback:\n{numbers(0, 1, 1)}Feedback:\n{numbers(0, 1, 1, 2)}"
    result = f"Result:\n{numbers(0, 1, 1, 2)}Goal finished with status: SUCCEEDED\n"
    assert re.fullmatch(re.escape(SENT.format(3)) + ACCEPTED + feedback + result, out)


def test_the_type_is_optional_and_values_may_be_assignments(action, run):
    code, out, _ = run("action", "send_goal", "/fibonacci", "order=1")
    assert code == 0
    assert out.endswith(f"Result:\n{numbers(0, 1)}Goal finished with status: SUCCEEDED\n")


def test_a_goal_from_standard_input(action, run, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"order: 2\n")))
    assert "order: 2\n" in run("action", "send_goal", "/fibonacci", TYPE, "--stdin")[1]


def test_an_aborted_goal_and_one_that_failed_exit_with_0_as_in_ros2(action, run):
    code, out, _ = run("action", "send_goal", "/fibonacci", "order=7")
    assert code == 0
    assert out.endswith("- 13\n\nGoal finished with status: ABORTED\n")
    code, out, _ = run("action", "send_goal", "/fibonacci", "order=8")
    assert code == 0
    assert out.endswith("No result: there is no eight\n\nGoal finished with status: ABORTED\n")


def test_a_rejected_goal_exits_with_0_as_in_ros2(action, run):
    code, out, err = run("action", "send_goal", "/fibonacci", "order=50")
    assert (code, out) == (0, SENT.format(50) + "Goal was rejected.\n")
    assert err == "  hint: the server of /fibonacci rejected the goal and gave no reason\n"


def test_the_reason_of_a_rejection_is_one_line_on_stderr(action, run):
    code, out, err = run("action", "send_goal", "/fibonacci", "order=60")
    assert (code, out) == (0, SENT.format(60) + "Goal was rejected.\n")
    assert err == "  hint: at most 49 numbers, not 60\n"


def test_json_prints_one_line_for_each_message(action, run):
    code, out, _ = run("action", "send_goal", "/fibonacci", "order=2", "-f", "--json")
    feedback, result = map(json.loads, out.splitlines())
    assert (code, feedback) == (0, {"feedback": {"sequence": [0, 1, 1]}})
    assert len(result.pop("goal_id")) == 32
    assert result == {"status": "SUCCEEDED", "result": {"sequence": [0, 1, 1]}}
    code, out, _ = run("action", "send_goal", "/fibonacci", "order=50", "--json")
    assert (code, json.loads(out)["accepted"]) == (0, False)


@pytest.mark.parametrize(
    ("line", "code", "problem"),
    [
        ("/fibonacci order=x", 1, "Failed to populate field: order: expected int32, got 'x'"),
        ("/fibonacci p/action/T", 1, "The passed action type is invalid\n  hint: package 'p'"),
        ("/fibonaci --timeout 0.1", 4, "no server offers the action /fibonaci (waited 0.1 s)"),
        (f"/fibonaci {TYPE} --timeout 0.1", 4, "  hint: did you mean /fibonacci?"),
        ("/fibonacci order=1 --stdin", 2, "--stdin: expected no goal on the command line"),
        ("/a//b", 1, "Invalid action name: action name must not contain repeated '/'"),
        ("/fibonacci --timeout x", 2, "expected seconds, or 0 or inf for no limit, got 'x'"),
    ],
)
def test_mistakes_are_one_message(action, run, line, code, problem):
    ended, _, err = run("action", "send_goal", *line.split())
    assert ended == code
    assert problem in err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends Ctrl-C to whole consoles only")
def test_ctrl_c_cancels_the_goal(action):
    command = [sys.executable, "-m", "taskrpc", "action", "send_goal", "/fibonacci", "order=9"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    for line in process.stdout:
        if line.startswith("Goal accepted"):
            process.send_signal(signal.SIGINT)
            break
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out.lstrip() == "Canceling goal...\nGoal canceled.\n"
    assert action.stdout.readline() == "cancelled\n"
