"""The course of the simulated robot at any moment, without a halt."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.robot.course import Course
from taskrpc.robot.kinematics import Limits, Motion
from taskrpc.robot.protocol import Pose

START = Pose(1.0, 1.0, 0.0)
DOCK = (1.0, 1.0)
WAYPOINTS = [(4.0, 1.0), (4.0, 3.0)]


def driving(work=2.0):
    course = Course(START, DOCK, Limits())
    course.assign(Motion(START, WAYPOINTS, Limits()), work)
    course.go(100.0)
    return course


@given(st.floats(0.0, 20.0))
def test_level_is_what_a_halt_would_leave(seconds):
    now = 100.0 + seconds
    course, halted = driving(), driving()
    halted.halt(now)
    assert course.level(now) == halted.standing
    assert course.began == 100.0  # it still drives


def test_battery_falls_and_odometer_grows_during_a_drive():
    course = driving()
    before, later = course.level(100.0), course.level(102.0)
    assert later.battery < before.battery == 100.0
    assert later.odometer > before.odometer == 0.0


def test_battery_of_a_robot_at_rest_falls_except_at_the_dock():
    course = driving()
    course.complete()
    end = course.standing.since
    assert course.level(end + 60.0).battery == pytest.approx(course.standing.battery - 0.6)
    docked = Course(START, DOCK, Limits())
    docked.go(0.0)
    docked.complete()
    assert docked.level(60.0).battery == 100.0


def test_path_begins_where_the_robot_set_out_and_is_empty_without_a_task():
    course = driving()
    assert course.path() == [(1.0, 1.0), *WAYPOINTS]
    course.halt(102.0)
    pose = course.standing.pose
    assert course.path() == [(pose.x, pose.y), *WAYPOINTS]
    course.clear()
    assert course.path() == []
