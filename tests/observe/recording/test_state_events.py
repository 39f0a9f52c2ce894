"""The events of decisions; `test_timeline` tests them with a whole run."""

from math import cos, sin

import pytest

from taskrpc.observe.recording.state_events import RobotClock, TaskEvents, heading
from taskrpc.robot.tasks.model import Task, TaskState


@pytest.mark.parametrize("angle", [0.0, 1.5, -3.1, 3.1])
def test_heading_of_a_pose_is_read_from_its_quaternion(angle):
    assert heading(sin(angle / 2), cos(angle / 2)) == pytest.approx(angle)


def task(number, state, **fields):
    return Task(
        task_id=number,
        task_type="move",
        target="dock",
        priority=5,
        arrival=number,
        submitted_at=0.0,
        state=state,
        **fields,
    )


def shown(tasks, time):
    (event,) = tasks.due(time)
    return event.data


def test_counts_stay_right_when_a_task_that_is_no_longer_shown_is_queued_again():
    tasks = TaskEvents(RobotClock(), 1000.0)
    for number in range(1, 41):
        list(tasks.change(0.0, task(number, TaskState.CANCELED)))
    assert shown(tasks, 10.0)["counts"] == {"CANCELED": 40}
    list(tasks.change(10.0, task(1, TaskState.QUEUED)))
    data = shown(tasks, 20.0)
    assert data["counts"] == {"CANCELED": 39}
    assert [each["task_id"] for each in data["ended"]] == list(range(40, 10, -1))


def test_results_of_a_long_run_are_thinned_out():
    tasks = TaskEvents(RobotClock(), 20_000.0)  # a result every ten seconds
    found = []
    for second in range(100):
        found += tasks.change(second, task(second + 1, TaskState.SUCCEEDED, result="{}"))
    assert [event.t for event in found] == list(range(0, 100, 10))
    assert {event.event for event in found} == {"task"}


def test_robot_clock_follows_the_time_of_day_at_the_speed_of_the_robot():
    clock = RobotClock()
    assert clock.now(100.0) is None
    clock.speed = 2.0
    clock.note(100.0, 7.0)
    assert clock.now(101.5) == 10.0
