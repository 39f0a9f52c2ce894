"""Arithmetic and conversions of times and durations, and clocks."""

import math

import rclpy
from builtin_interfaces.msg import Duration as DurationMessage
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.clock import Clock, ClockType, ROSClock
from rclpy.duration import Duration, Infinite
from rclpy.time import Time
from shared import attempt, end

STEADY, SYSTEM, ROS = ClockType.STEADY_TIME, ClockType.SYSTEM_TIME, ClockType.ROS_TIME


def durations():
    one, half = Duration(seconds=1), Duration(nanoseconds=500_000_000)
    for what, action in {
        "plus": lambda: one + half,
        "minus": lambda: half - one,
        "times int": lambda: half * 3,
        "times float": lambda: one * 0.25,
        "int times": lambda: 3 * half,
        "times text": lambda: one * "2",
        "times nan": lambda: one * math.nan,
        "times infinity": lambda: one * math.inf,
        "plus number": lambda: one + 1,
        "plus time": lambda: one + Time(seconds=5),
        "divided": lambda: one / 2,
        "negative": lambda: -one,
        "absolute": lambda: abs(Duration(seconds=-1)),
        "equal": lambda: (one == Duration(nanoseconds=10**9), one == 1, one != half),
        "less": lambda: (one < half, one <= one, one > half, one >= half),
        "less than number": lambda: one < 1,
        "hash": lambda: hash(one) == hash(Duration(seconds=1)),
        "text": lambda: (repr(one), str(half), str(Infinite)),
        "fraction": lambda: Duration(seconds=1.9999999999),
        "both": lambda: Duration(seconds=1, nanoseconds=-1),
        "too long": lambda: Duration(seconds=2**63),
        "too short": lambda: Duration(nanoseconds=-(2**63) - 1),
        "positional": lambda: Duration(1),
        "message": lambda: Duration(seconds=-1.5).to_msg(),
        "from message": lambda: Duration.from_msg(DurationMessage(sec=-2, nanosec=500_000_000)),
        "from other message": lambda: Duration.from_msg(TimeMessage()),
        "nanoseconds": lambda: one.nanoseconds,
        "set": lambda: setattr(one, "nanoseconds", 5),
        "truth": lambda: bool(Duration()),
    }.items():
        attempt(f"duration {what}", action)


def times():
    one, later = Time(seconds=1), Time(seconds=3, nanoseconds=5)
    for what, action in {
        "plus": lambda: one + Duration(seconds=1),
        "minus duration": lambda: later - Duration(seconds=1),
        "minus time": lambda: later - one,
        "before": lambda: one - later,
        "below zero": lambda: one - Duration(seconds=2),
        "overflow": lambda: Time(nanoseconds=2**63 - 1) + Duration(nanoseconds=1),
        "plus time": lambda: one + later,
        "plus number": lambda: one + 1,
        "minus number": lambda: one - 1,
        "other clock minus": lambda: later - Time(clock_type=ROS),
        "other clock less": lambda: later < Time(clock_type=ROS),
        "other clock equal": lambda: Time() == Time(clock_type=ROS),
        "equal number": lambda: one == 1,
        "less than number": lambda: one < 1,
        "order": lambda: (one < later, one <= one, one > later, one >= later, one != later),
        "hash": lambda: hash(one) == hash(Time(seconds=1)),
        "text": lambda: (repr(one), str(later), repr(Time(clock_type=STEADY))),
        "fraction": lambda: Time(seconds=1.5).nanoseconds,
        "float": lambda: Time(seconds=0.1).nanoseconds,
        "text given": lambda: Time(seconds="1"),
        "wrong clock": lambda: Time(clock_type=5),
        "parts": lambda: later.seconds_nanoseconds(),
        "message": lambda: later.to_msg(),
        "late message": lambda: Time(seconds=2**31).to_msg(),
        "from message": lambda: Time.from_msg(TimeMessage(sec=5, nanosec=7)),
        "from message clock": lambda: (
            Time.from_msg(TimeMessage(), clock_type=STEADY).clock_type.name
        ),
        "from negative": lambda: Time.from_msg(TimeMessage(sec=-5)),
        "from other message": lambda: Time.from_msg(DurationMessage()),
        "clock": lambda: one.clock_type.name,
    }.items():
        attempt(f"time {what}", action)


def clocks():
    for kind in (ROS, SYSTEM, STEADY):
        attempt(f"clock {kind.name}", lambda kind=kind: Clock(clock_type=kind).clock_type.name)
        attempt(f"class of {kind.name}", lambda kind=kind: type(Clock(clock_type=kind)).__name__)
    attempt("clock of a text", lambda: Clock(clock_type="steady"))
    attempt("clock text", lambda: str(Clock(clock_type=STEADY)))
    clock = ROSClock()
    attempt("active", lambda: clock.ros_time_is_active)
    attempt("set time", lambda: clock.set_ros_time_override(Time(seconds=7, clock_type=ROS)))
    clock._set_ros_time_is_active(True)
    attempt("now", lambda: clock.now())
    attempt("set other", lambda: clock.set_ros_time_override(Time(seconds=7)))
    attempt("set number", lambda: clock.set_ros_time_override(7))
    attempt("sleep number", lambda: clock.sleep_for(1))
    steady = Clock(clock_type=STEADY)
    attempt("sleep", lambda: steady.sleep_for(Duration(nanoseconds=1000)))
    attempt("sleep back", lambda: steady.sleep_for(Duration(seconds=-1)))
    attempt("jump number", lambda: clock.create_jump_callback(5))


def jumps():
    from rclpy.clock import JumpThreshold

    for what, settings in {
        "zero forward": {"min_forward": Duration(), "min_backward": None},
        "negative forward": {"min_forward": Duration(seconds=-1), "min_backward": None},
        "zero backward": {"min_forward": None, "min_backward": Duration()},
        "positive backward": {"min_forward": None, "min_backward": Duration(seconds=1)},
        "nothing": {"min_forward": None, "min_backward": None, "on_clock_change": False},
        "plain": {"min_forward": Duration(seconds=1), "min_backward": Duration(seconds=-1)},
    }.items():
        attempt(
            f"threshold {what}", lambda settings=settings: type(JumpThreshold(**settings)).__name__
        )
    clock = ROSClock()
    told = []
    before = lambda: told.append("before")  # noqa: E731

    def after(jump):
        told.append((jump.clock_change.name, jump.delta.nanoseconds))

    threshold = JumpThreshold(min_forward=Duration(seconds=2), min_backward=Duration(seconds=-2))
    handle = clock.create_jump_callback(threshold, pre_callback=before, post_callback=after)
    clock._set_ros_time_is_active(True)
    for seconds in (100, 101, 103, 102, 99, 200):
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ROS))
        print("jump to", seconds, [each for each in told if each != ("ROS_TIME_ACTIVATED", 0)])
        told.clear()
    clock._set_ros_time_is_active(True)
    print("active again", [each if each == "before" else each[0] for each in told])
    told.clear()
    clock._set_ros_time_is_active(False)
    print("inactive", [each if each == "before" else each[0] for each in told])
    told.clear()
    handle.unregister()
    clock._set_ros_time_is_active(True)
    print("unregistered", told)
    attempt("no callbacks", lambda: clock.create_jump_callback(threshold))


rclpy.init()
durations()
times()
clocks()
jumps()
end()
