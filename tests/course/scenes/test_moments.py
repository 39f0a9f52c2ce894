"""The words for what happens in a scene."""

import msgspec
import pytest

from taskrpc.course.scenes import moments
from taskrpc.course.scenes.moments import NETWORK, PROGRAM, ROBOT, SIMULATOR, TASKRPC


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


def test_simulated_run_that_fails_is_told_by_its_callbacks_and_its_output():
    events = [
        {"time": 0.8, "program": "shop", "kind": "call", "text": "/pick"},
        {"time": 0.84, "program": "shop", "kind": "begin", "text": "/pick"},
        {"time": 1.0, "program": "shop", "kind": "print", "text": "ada gets box A"},
    ]
    result = {"failure": {"text": "box A was given away twice\nits line", "events": events}}
    assert moments.of_simulation(msgspec.json.encode(result), 200) == [
        (SIMULATOR, "a run fails: box A was given away twice"),
        (SIMULATOR, "0.84 s  executes /pick"),
        (SIMULATOR, "1.00 s  prints: ada gets box A"),
    ]


def test_simulation_without_a_failure_says_how_many_runs_there_were():
    assert moments.of_simulation(b'{"failure": null}', 200) == [
        (SIMULATOR, "200 runs in virtual time: none fails")
    ]


def test_output_that_is_no_result_is_refused():
    with pytest.raises(msgspec.MsgspecError):
        moments.of_simulation(b"", 200)
