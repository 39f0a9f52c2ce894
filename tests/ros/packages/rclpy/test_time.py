"""`Time` and `Duration`."""

from __future__ import annotations

import datetime
import operator

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.ros.packages.rclpy.clock_type import ClockType
from taskrpc.ros.packages.rclpy.duration import Duration, Infinite
from taskrpc.ros.packages.rclpy.time import Time

ORDERS = [operator.lt, operator.le, operator.gt, operator.ge]
nanoseconds = st.integers(0, 2**62 - 1)


def test_a_time_is_seconds_and_nanoseconds_of_a_clock():
    time = Time(seconds=1, nanoseconds=5e8, clock_type=ClockType.STEADY_TIME)
    assert (time.nanoseconds, time.clock_type) == (1500000000, ClockType.STEADY_TIME)
    assert time.seconds_nanoseconds() == (1, 500000000)
    assert repr(time) == "Time(nanoseconds=1500000000, clock_type=STEADY_TIME)"
    assert Time().nanoseconds == 0
    assert Time(nanoseconds=2**63 - 1).nanoseconds == 2**63 - 1


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"nanoseconds": 2**63}, OverflowError),
        ({"seconds": -1}, ValueError),
        ({"nanoseconds": -1}, ValueError),
        ({"clock_type": "SYSTEM_TIME"}, TypeError),
    ],
)
def test_time_out_of_range_is_refused(arguments, error):
    with pytest.raises(error):
        Time(**arguments)


def test_a_duration_may_be_negative_and_has_63_bits():
    assert Duration(seconds=1, nanoseconds=5e8).nanoseconds == 1500000000
    assert Duration(seconds=-0.5).nanoseconds == -500000000
    assert Duration(nanoseconds=-(2**63)).nanoseconds == -(2**63)
    for beyond in (2**63, -(2**63) - 1):
        with pytest.raises(OverflowError, match="too large"):
            Duration(nanoseconds=beyond)


@pytest.mark.parametrize("seconds", ["1", [1]])
def test_seconds_of_a_duration_must_be_a_number(seconds):
    with pytest.raises(TypeError, match="expected seconds as a number, got "):
        Duration(seconds=seconds)


def test_duration_has_a_readable_text():
    assert repr(Duration(nanoseconds=3)) == "Duration(nanoseconds=3)"
    assert (str(Duration(nanoseconds=3)), str(Infinite)) == ("3 nanoseconds", "Infinite")


@given(nanoseconds, nanoseconds)
def test_times_and_durations_add_up(one, two):
    time, span = Time(nanoseconds=one, clock_type=ClockType.ROS_TIME), Duration(nanoseconds=two)
    assert time + span == span + time
    assert (time + span) - time == span
    assert (time + span) - span == time
    assert (time + span).clock_type is ClockType.ROS_TIME
    assert Duration(nanoseconds=one) + span - span == Duration(nanoseconds=one)


def test_a_duration_is_multiplied():
    assert Duration(seconds=2) * 2 == Duration(seconds=4)
    assert Duration(seconds=2) * 0.25 == Duration(seconds=0.5)
    assert Duration(seconds=2) * float("inf") == Infinite
    with pytest.raises(ValueError, match="nan"):
        Duration(seconds=2) * float("nan")


def test_invalid_arguments_are_refused():
    time, span = Time(nanoseconds=1), Duration(nanoseconds=2)
    for meaningless in (
        lambda: time + time,
        lambda: span - time,
        lambda: span * "2",
        lambda: span + 1,
        lambda: span - 1,
        lambda: time - 1,
        lambda: time - Time(clock_type=ClockType.STEADY_TIME),
    ):
        with pytest.raises(TypeError):
            meaningless()
    with pytest.raises(ValueError, match="negative time"):
        time - span
    with pytest.raises(OverflowError, match="overflow"):
        Time(nanoseconds=2**63 - 1) + span


@given(nanoseconds, nanoseconds)
def test_times_and_durations_are_in_the_order_of_their_nanoseconds(one, two):
    for order in [*ORDERS, operator.eq, operator.ne]:
        assert order(Time(nanoseconds=one), Time(nanoseconds=two)) == order(one, two)
        assert order(Duration(nanoseconds=one), Duration(nanoseconds=two)) == order(one, two)


def test_times_of_different_clocks_cannot_be_compared():
    one, two = Time(nanoseconds=1), Time(nanoseconds=1, clock_type=ClockType.STEADY_TIME)
    for order in [*ORDERS, operator.eq, operator.ne]:
        with pytest.raises(TypeError, match="different clock types"):
            order(one, two)


def test_a_time_a_duration_and_a_number_are_never_equal():
    time, span = Time(nanoseconds=1), Duration(nanoseconds=1)
    assert time != span
    assert time != 1
    assert span != 1
    for order in ORDERS:
        for other in (span, 1):
            with pytest.raises(TypeError):
                order(time, other)


@given(nanoseconds.filter(lambda number: number < 2**31 * 10**9))
def test_conversion_to_a_message_and_back_changes_nothing(number):
    time, span = Time(nanoseconds=number), Duration(nanoseconds=-number)
    assert Time.from_msg(time.to_msg(), ClockType.SYSTEM_TIME) == time
    assert Time.from_msg(time.to_msg()).clock_type is ClockType.ROS_TIME
    assert Duration.from_msg(span.to_msg()) == span


def test_conversion_from_another_message_type_is_refused():
    with pytest.raises(TypeError, match=r"builtin_interfaces\.msg\.Time"):
        Time.from_msg(srvgen.load("builtin_interfaces/msg/Duration")())
    with pytest.raises(TypeError, match=r"builtin_interfaces\.msg\.Duration"):
        Duration.from_msg(3)


def test_a_time_since_1970_is_a_date():
    moment = datetime.datetime(2026, 1, 2, 3, 4, 5)
    assert Time(seconds=moment.timestamp()).to_datetime() == moment
    with pytest.raises(TypeError, match="ROS_TIME or SYSTEM_TIME"):
        Time(clock_type=ClockType.STEADY_TIME).to_datetime()
