"""The words for what happens in a scene."""

import pytest

from taskrpc.course.scenes import moments
from taskrpc.course.scenes.moments import NETWORK, PROGRAM, ROBOT, TASKRPC


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("", None),
        ("  \r", None),
        ("not done yet\r", (PROGRAM, "not done yet")),
        ("[taskrpc] ROS 2 would hang", (TASKRPC, "ROS 2 would hang")),
        ("problem.py:19: WouldDeadlock: why", (PROGRAM, "ends in line 19 with WouldDeadlock")),
    ],
)
def test_output_of_the_program(line, expected):
    assert moments.of_output(line) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "fault in call 1 of /robot_task from /operator: the response is lost",
            (NETWORK, "call 1: the response is lost"),
        ),
        (
            "Task 2 queued: report to central (priority: 5)",
            (ROBOT, "task 2 is in the queue"),
        ),
        ("Executing task 2: report - central", (ROBOT, "executes task 2")),
        ("Task 2 completed", None),
        ("something else", None),
    ],
)
def test_log_of_the_robot(text, expected):
    assert moments.of_log(text) == expected


def test_calls():
    assert moments.of_request(3) == (NETWORK, "call 3: the request arrives")
    assert moments.of_response(3, repeated=False) == (NETWORK, "call 3: the response is sent")
    assert "stored" in moments.of_response(3, repeated=True)[1]


def test_hang_says_how_long_it_lasted():
    assert moments.of_hang(3.5)[1].startswith("still waits after 3.5 s")
