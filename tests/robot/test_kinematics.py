"""Closed-form motion agrees with the step-by-step integration of the same drive."""

import math
from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from taskrpc.robot.kinematics import Leg, Limits, Motion, Trapezoid, normalised
from taskrpc.robot.protocol import Pose

LIMITS = Limits()
lengths = st.floats(1e-3, 50.0)
rates = st.floats(0.1, 5.0)
coordinates = st.floats(0.0, 10.0)
points = st.tuples(coordinates, coordinates)
poses = st.builds(Pose, coordinates, coordinates, st.floats(-math.pi, math.pi))


def integrated(length, speed, acceleration, steps=4000):
    """Drive in small steps: as fast as the top speed and the braking distance allow."""
    profile = Trapezoid(length, speed, acceleration)
    dt = profile.duration / steps
    travelled, velocity, track = 0.0, 0.0, [0.0]
    for _ in range(steps):
        brake = math.sqrt(max(0.0, 2 * acceleration * (length - travelled)))
        faster = min(speed, velocity + acceleration * dt, brake)
        travelled += dt * (velocity + faster) / 2
        velocity = faster
        track.append(travelled)
    return profile, dt, track


@given(lengths, rates, rates)
def test_trapezoid_agrees_with_bang_bang_control(length, speed, acceleration):
    profile, dt, track = integrated(length, speed, acceleration, steps=400)
    for step in range(0, 401, 20):
        assert profile.at(step * dt) == pytest.approx(track[step], abs=0.02 * length)
    assert track[-1] == pytest.approx(length, rel=0.02)


@given(lengths, rates, rates, st.floats(0, 1), st.floats(0, 1))
def test_a_trapezoid_never_exceeds_its_top_speed_and_never_goes_back(length, v, a, s, t):
    profile = Trapezoid(length, v, a)
    early, late = sorted((s * profile.duration, t * profile.duration))
    step = profile.at(late) - profile.at(early)
    assert -1e-9 <= step <= v * (late - early) + 1e-9


@given(lengths, rates, rates)
def test_a_trapezoid_starts_at_nothing_and_ends_exactly_at_its_length(length, v, a):
    profile = Trapezoid(length, v, a)
    assert profile.at(-1.0) == profile.at(0.0) == 0.0
    assert profile.at(profile.duration) == profile.at(profile.duration + 1) == length
    assert profile.at(profile.duration * (1 - 1e-12)) == pytest.approx(length)


@given(lengths, rates, rates)
def test_a_trapezoid_is_symmetric_in_time(length, v, a):
    profile = Trapezoid(length, v, a)
    for share in (0.1, 0.3, 0.5):
        t = share * profile.duration
        assert profile.at(t) + profile.at(profile.duration - t) == pytest.approx(length)


@pytest.mark.parametrize(
    ("length", "seconds"), [(0.0, 0.0), (1.0, 2.0), (4.0, 4.0), (10.0, 7.0), (0.25, 1.0)]
)
def test_durations_that_can_be_done_in_the_head(length, seconds):
    """At 2 m/s and 1 m/s^2 ramps of 2 s take 2 m each."""
    assert Trapezoid(length, 2.0, 1.0).duration == pytest.approx(seconds)


@given(poses, points)
def test_a_leg_turns_on_the_spot_before_it_drives_straight(start, goal):
    assume(math.dist((start.x, start.y), goal) > 1e-3)
    leg = Leg(start, goal, LIMITS)
    for share in (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0):
        t = share * leg.duration
        pose = leg.pose_at(t)
        driven = math.dist((pose.x, pose.y), (start.x, start.y))
        assert driven == pytest.approx(leg.distance_at(t), abs=1e-9)
        if driven:
            assert pose.theta == leg.end.theta
            assert math.dist((pose.x, pose.y), goal) == pytest.approx(leg.length - driven, abs=1e-9)


@given(poses, points)
def test_a_robot_turns_the_short_way(start, goal):
    assume(math.dist((start.x, start.y), goal) > 1e-3)
    leg = Leg(start, goal, LIMITS)
    half_turn = Trapezoid(math.pi, LIMITS.turn_speed, LIMITS.turn_acceleration).duration
    straight = Trapezoid(leg.length, LIMITS.speed, LIMITS.acceleration).duration
    assert leg.duration <= half_turn + straight + 1e-9


@given(poses, st.lists(points, max_size=5), st.floats(0, 1))
def test_a_motion_is_continuous_and_ends_at_its_last_waypoint(start, waypoints, share):
    motion = Motion(start, waypoints, LIMITS)
    t, dt = share * motion.duration, 1e-4
    before, after = motion.pose_at(t), motion.pose_at(t + dt)
    moved = math.dist((before.x, before.y), (after.x, after.y))
    # Places closer than a micrometre count as one, so the robot may end that far beside it.
    assert moved <= LIMITS.speed * dt + 2e-6
    assert abs(normalised(after.theta - before.theta)) <= LIMITS.turn_speed * dt + 1e-6
    assert motion.pose_at(motion.duration) == motion.end
    if waypoints:
        assert math.dist((motion.end.x, motion.end.y), waypoints[-1]) <= 1e-6


@given(poses, st.lists(points, min_size=1, max_size=5), st.floats(0, 1))
def test_a_motion_is_its_legs_one_after_the_other(start, waypoints, share):
    motion = Motion(start, waypoints, LIMITS)
    here, began, driven = start, 0.0, 0.0
    for point in waypoints:
        if math.dist((here.x, here.y), point) <= 1e-6:
            continue
        leg = Leg(here, point, LIMITS)
        t = share * leg.duration
        pose, expected = motion.pose_at(began + t), leg.pose_at(t)
        assert (pose.x, pose.y) == pytest.approx((expected.x, expected.y), abs=1e-6)
        assert motion.distance_at(began + t) == pytest.approx(driven + leg.distance_at(t), abs=1e-6)
        here, began, driven = leg.end, began + leg.duration, driven + leg.length
    assert motion.duration == pytest.approx(began)
    assert motion.distance == pytest.approx(driven)


@given(poses, st.lists(points, max_size=5), st.floats(0, 1))
def test_distance_at_is_the_length_of_the_track_so_far(start, waypoints, share):
    motion = Motion(start, waypoints, LIMITS)
    t = share * motion.duration
    times = [t * k / 2000 for k in range(2001)]
    track = [motion.pose_at(time) for time in times]
    walked = math.fsum(math.dist((a.x, a.y), (b.x, b.y)) for a, b in pairwise(track))
    assert motion.distance_at(t) == pytest.approx(walked, abs=1e-2)


@given(poses, st.lists(points, min_size=1, max_size=5), st.floats(0, 1))
def test_a_motion_cut_anywhere_still_ends_at_the_same_point(start, waypoints, share):
    motion = Motion(start, waypoints, LIMITS)
    t = share * motion.duration
    rest = Motion(motion.pose_at(t), motion.waypoints_after(t), LIMITS)
    end = rest.end
    assert math.dist((end.x, end.y), (motion.end.x, motion.end.y)) <= 1e-6
    assert motion.distance_at(t) + rest.distance == pytest.approx(motion.distance, abs=1e-5)


@given(poses)
def test_motion_to_own_position_takes_no_time_and_keeps_the_heading(pose):
    motion = Motion(pose, [(pose.x, pose.y)], LIMITS)
    assert (motion.duration, motion.distance, motion.end) == (0.0, 0.0, pose)
    assert motion.pose_at(0.0) == pose
    assert motion.waypoints_after(0.0) == []


@given(st.floats(-100, 100))
def test_a_normalised_angle_is_the_same_direction_and_has_one_name(angle):
    wrapped = normalised(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_straight_back_is_plus_pi():
    assert normalised(-math.pi) == normalised(3 * math.pi) == math.pi
