"""Each scene is played, and its programs do what its texts say."""

import pytest

from taskrpc.course.scenes.catalogue import SCENES, scene
from taskrpc.course.scenes.player import Lines, play
from tests.cli.course.scene.screens import rows

EACH = pytest.mark.parametrize("each", SCENES, ids=lambda each: each.name)

PROBLEMS = {
    "lost-reply": [
        "call 1: the request arrives",
        "call 1: the response is lost",
        "executes task 1",
        "no response after 1.5 s: will the robot drive, or not?",
    ],
    "late-answer": [
        "executes task 1",
        "the call failed: I tell the user that the robot is broken",
        "call 1: the response is sent",
        "a moment later, the same future says: Task queued: report",
    ],
    "retry-without-id": [
        "call 1: the response is lost",
        "executes task 1",
        "attempt 1 failed, retrying...",
        "I wanted one task, and this is number 2",
        "executes task 2",
    ],
    "timeout-too-short": [
        "attempt 1 timed out",
        "attempt 2 timed out",
        "task 2 is in the queue",
        "executes task 2",
    ],
    "deadlock": ["double: I call add, and wait for its response", "ends in line 19 with"],
    "nobody-spins": ["call 1: the response is sent", "ROS 2 would", "still waits after"],
    "forgot-return": ["add: the sum is 5", "the caller has a response: False"],
    "wrong-type": 3 * ["is there a service /robot_task? False"],
    "two-servers": ["the old server moves the arm", "the response is from the old server"],
    "eleven-calls": ["add has handled 1 2 3 4 5 6 7 8 9 10 11 12", "responses: 12 of 12"],
    "same-box": ["a run fails: box A was given away twice"],
}
"""What happens in this order, with taskrpc; each is the beginning of a moment."""
EXPLANATIONS = {
    "deadlock": "ROS 2 would hang here for ever",
    "nobody-spins": "no thread spins /operator",
    "forgot-return": "is `return response` (AddTwoInts_Response) missing at its end?",
    "wrong-type": "/robot_task is offered as my_robot_interfaces/srv/RobotTask",
    "two-servers": "ROS 2 would let both servers of /move_arm run every request",
    "eleven-calls": "ROS 2 would drop the oldest of more than 10 requests",
}
LIKE_ROS = {
    "deadlock": ["double: I call add, and wait for its response", "still waits after 3.5 s"],
    "forgot-return": [
        "add: the sum is 5",
        "the server ends with TypeError:",
        "the caller has a response: False",
    ],
    "wrong-type": 3 * ["is there a service /robot_task? False"],
    "two-servers": ["the old server moves the arm", "the new server moves the arm"],
    "eleven-calls": ["add has handled 3 4 5 6 7 8 9 10 11 12", "responses: 10 of 12"],
}
CURES = {
    "lost-reply": ["call 2: the stored response is sent", "the robot accepted task 1"],
    "late-answer": ["no response yet: the robot may", "the robot accepted task 1"],
    "retry-without-id": [
        "call 2: the stored response is sent",
        "I wanted one task, and this is number 1",
    ],
    "timeout-too-short": ["attempt 1 worked", "executes task 1"],
    "deadlock": ["21 doubled is 42"],
    "nobody-spins": ["the robot accepted task 1"],
    "forgot-return": ["the caller has a response: True"],
    "wrong-type": ["is there a service /robot_task? True", "the robot accepted task 1"],
    "two-servers": ["the new server moves the arm", "the response is from the new server"],
    "eleven-calls": ["responses: 12 of 12"],
    "same-box": ["200 runs in virtual time: none fails"],
}
TASKS = {"retry-without-id": 2, "timeout-too-short": 2, "wrong-type": 0}
"""How many tasks the robot executes because of the mistake; 1 if the scene is not here."""


async def moments_of(each, **options):
    """Play one program of a scene; returns its moments, in order."""
    seen = []
    await play(each, seen.append, **options)
    return seen


def assert_in_order(expected, moments):
    rest = iter(moments)
    for text in expected:
        assert any(each.text.startswith(text) for each in rest), (text, moments)


def executed(moments):
    return sum(each.text.startswith("executes task") for each in moments)


@pytest.mark.labs
@pytest.mark.real_time
@EACH
async def test_problem(each):
    seen = await moments_of(each)
    assert_in_order(PROBLEMS[each.name], seen)
    explained = "".join(moment.text for moment in seen if moment.actor == "taskrpc")
    assert EXPLANATIONS.get(each.name, "") in explained
    assert bool(explained) == (each.name in EXPLANATIONS)
    assert executed(seen) == each.robot * TASKS.get(each.name, 1)
    assert rows(each, seen, cure=False) <= 25


@pytest.mark.labs
@pytest.mark.real_time
@pytest.mark.parametrize("name", LIKE_ROS)
async def test_like_ros(name):
    seen = await moments_of(scene(name), like_ros=True)
    assert_in_order(LIKE_ROS[name], seen)
    assert {moment.actor for moment in seen} == {"program"}, "ROS 2 explains nothing"


@pytest.mark.labs
@pytest.mark.real_time
async def test_like_ros_nothing_is_simulated():
    seen = await moments_of(scene("same-box"), like_ros=True)
    assert [moment.actor for moment in seen] == ["program", "program"]


@pytest.mark.labs
@pytest.mark.real_time
@EACH
async def test_cure(each):
    seen = await moments_of(each, cure=True)
    assert_in_order(CURES[each.name], seen)
    assert {moment.actor for moment in seen} <= {"program", "network", "robot", "simulate"}
    assert executed(seen) == each.robot
    assert rows(each, seen, cure=True) <= 25


def test_output_is_reported_line_by_line_and_by_stream():
    seen = []
    lines = Lines(lambda *what: seen.append(what))
    lines.feed(1, b"one\ntw")
    lines.feed(2, b"[taskrpc] why\n")
    lines.feed(1, b"o")
    assert seen == [("program", "one"), ("taskrpc", "why")]
    lines.end()
    assert seen[2:] == [("program", "two")]
