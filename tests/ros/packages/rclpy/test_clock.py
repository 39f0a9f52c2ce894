"""Clocks: their time, their jumps, and `sleep_until`."""

from __future__ import annotations

import threading
import time

import pytest

from taskrpc.ros.packages.rclpy.clock import (
    Clock,
    ClockChange,
    ClockType,
    JumpThreshold,
    ROSClock,
    TimeJump,
)
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.duration import Duration
from taskrpc.ros.packages.rclpy.exceptions import NotInitializedException
from taskrpc.ros.packages.rclpy.time import Time

FORWARD, BACK = Duration(seconds=1), Duration(seconds=-1)


def test_clock_has_a_type():
    assert Clock().clock_type is ClockType.SYSTEM_TIME
    assert repr(Clock(clock_type=ClockType.STEADY_TIME)) == "Clock(clock_type=STEADY_TIME)"
    assert isinstance(Clock(clock_type=ClockType.ROS_TIME), ROSClock)
    assert ROSClock().clock_type is ClockType.ROS_TIME
    with pytest.raises(TypeError, match="ClockType"):
        Clock(clock_type="STEADY_TIME")


def test_clocks_show_their_time():
    assert abs(Clock().now().nanoseconds * 1e-9 - time.time()) < 5
    assert abs(ROSClock().now().nanoseconds * 1e-9 - time.time()) < 5
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    times = [steady.now() for _ in range(5)]
    assert times == sorted(times)
    assert times[0] < times[-1]


def test_simulated_time_is_shown_while_it_is_active():
    clock = ROSClock()
    clock.set_ros_time_override(Time(seconds=7))
    assert clock.now() > Time(seconds=10**9, clock_type=ClockType.ROS_TIME)
    clock._set_ros_time_is_active(True)
    assert clock.ros_time_is_active
    assert clock.now() == Time(seconds=7, clock_type=ClockType.ROS_TIME)
    clock._set_ros_time_is_active(False)
    assert not clock.ros_time_is_active
    with pytest.raises(TypeError, match=r"rclpy\.time\.Time"):
        clock.set_ros_time_override(7)


@pytest.mark.parametrize(
    ("forward", "backward", "change", "message"),
    [
        (Duration(), BACK, True, "min_forward"),
        (BACK, BACK, True, "min_forward"),
        (FORWARD, Duration(), True, "min_backward"),
        (FORWARD, FORWARD, True, "min_backward"),
        (None, None, False, "must be enabled"),
    ],
)
def test_invalid_jump_threshold_is_refused(forward, backward, change, message):
    with pytest.raises(ValueError, match=message):
        JumpThreshold(min_forward=forward, min_backward=backward, on_clock_change=change)


def listening(clock, **threshold):
    seen = []
    handle = clock.create_jump_callback(
        JumpThreshold(**{"min_forward": None, "min_backward": None, **threshold}),
        pre_callback=lambda: seen.append(clock.now().nanoseconds),
        post_callback=lambda jump: seen.append((clock.now().nanoseconds, jump)),
    )
    return handle, seen


def test_jumps_above_the_threshold_are_reported_before_and_after():
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(nanoseconds=100))
    span = Duration(nanoseconds=50)
    _, far = listening(clock, min_forward=span, on_clock_change=False)
    _, back = listening(clock, min_backward=Duration(nanoseconds=-50), on_clock_change=False)
    for nanoseconds in (149, 199, 150, 100):
        clock.set_ros_time_override(Time(nanoseconds=nanoseconds))
    assert [one if isinstance(one, int) else one[0] for one in far] == [149, 199]
    assert [one if isinstance(one, int) else one[0] for one in back] == [150, 100]
    jump = far[1][1]
    assert (jump.clock_change, jump.delta) == (ClockChange.ROS_TIME_NO_CHANGE, span)


def test_a_change_of_the_time_source_is_reported_once():
    clock = ROSClock()
    _, seen = listening(clock, on_clock_change=True)
    _, not_asked = listening(clock, min_forward=FORWARD, on_clock_change=False)
    clock._set_ros_time_is_active(True)
    clock._set_ros_time_is_active(True)
    clock._set_ros_time_is_active(False)
    changes = [each[1].clock_change for each in seen if isinstance(each, tuple)]
    assert changes == [ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED]
    assert not_asked == []


def test_an_unregistered_handle_receives_no_jumps():
    clock = ROSClock()
    handle, seen = listening(clock, on_clock_change=True)
    with handle:
        clock._set_ros_time_is_active(True)
    told = len(seen)
    handle.unregister()
    clock._set_ros_time_is_active(False)
    assert len(seen) == told == 2


def test_a_jump_handle_needs_a_callable():
    threshold = JumpThreshold(min_forward=FORWARD, min_backward=None)
    for callbacks in ({}, {"pre_callback": 1}, {"post_callback": 1}):
        with pytest.raises(ValueError, match="callable"):
            ROSClock().create_jump_callback(threshold, **callbacks)
    with pytest.raises(TypeError, match="ClockChange"):
        TimeJump("no", FORWARD)


# Sleeping


@pytest.mark.parametrize("kind", list(ClockType))
def test_sleeping_ends_when_the_clock_shows_the_time(context, kind):
    clock, span = Clock(clock_type=kind), Duration(seconds=0.01)
    begin = clock.now()
    assert clock.sleep_until(begin + span, context)
    assert clock.sleep_for(span, context)
    assert clock.now() - begin >= Duration(seconds=0.02)
    assert clock.sleep_until(begin, context)


def test_sleeping_needs_a_time_of_the_same_clock_type_and_an_initialised_context(context):
    clock = Clock()
    with pytest.raises(ValueError, match="clock type does not match"):
        clock.sleep_until(Time(clock_type=ClockType.STEADY_TIME), context)
    with pytest.raises(NotInitializedException):
        clock.sleep_for(FORWARD, Context())


def slept(clock, context, until, then):
    """Return the result of sleep_until, while `then` runs in this thread."""
    ends = []
    thread = threading.Thread(target=lambda: ends.append(clock.sleep_until(until, context)))
    thread.start()
    while not clock._jump_handles:
        time.sleep(0.001)
    time.sleep(0.005)
    assert ends == []
    then()
    thread.join(5)
    return ends


@pytest.mark.real_time
@pytest.mark.parametrize("active", [True, False])
def test_a_change_of_the_times_source_ends_the_sleep(context, active):
    clock = ROSClock()
    clock._set_ros_time_is_active(not active)
    until = clock.now() + Duration(seconds=10)
    ended = slept(clock, context, until, lambda: clock._set_ros_time_is_active(active))
    assert ended == [False]


@pytest.mark.real_time
def test_the_contexts_shutdown_ends_the_sleep(context):
    clock = Clock()
    assert slept(clock, context, clock.now() + Duration(seconds=9), context.shutdown) == [False]


@pytest.mark.real_time
def test_simulated_time_ends_the_sleep(context):
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    until = Time(seconds=11, clock_type=ClockType.ROS_TIME)
    assert slept(clock, context, until, lambda: clock.set_ros_time_override(until)) == [True]
