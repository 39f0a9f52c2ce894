"""Timers and rates."""

from __future__ import annotations

import functools
import threading
import time

import pytest

from taskrpc.ros.packages.rclpy.clock import ROSClock, Time
from taskrpc.ros.packages.rclpy.clock_type import ClockType
from taskrpc.ros.packages.rclpy.exceptions import InvalidHandle, RCLError, ROSInterruptException
from taskrpc.ros.packages.rclpy.timer import Rate, Timer, TimerInfo
from tests.ros.packages.rclpy.fakes import FakeClock


@pytest.fixture
def clock():
    return FakeClock()


def calls_of(executor, clock, timer, seconds, step=0.1):
    """Return the times of the timer's calls while the clock moves on."""
    seen = []
    timer.callback = lambda: seen.append(round(clock.ns / 1e9, 3))
    for _ in range(round(seconds / step)):
        clock.go_on(step)
        executor.spin_once(0)
    return seen


def test_a_timer_calls_back_once_a_period(executor, fake, clock):
    timer = fake.timer(0.5, None, clock)
    assert calls_of(executor, clock, timer, 2.2) == [0.5, 1.0, 1.5, 2.0]


def test_missed_periods_are_left_out_and_the_rhythm_is_kept(executor, fake, clock):
    timer = fake.timer(1, None, clock)
    clock.go_on(3.4)
    assert calls_of(executor, clock, timer, 2, step=0.2) == [3.6, 4.0, 5.0]


@pytest.mark.parametrize("seconds", [1, 2, 3])
def test_a_timer_calls_once_at_a_multiple_of_its_period(executor, fake, clock, seconds):
    timer = fake.timer(0.5, None, clock)
    seen = []
    timer.callback = lambda: seen.append(clock.ns)
    clock.go_on(seconds)
    for _ in range(3):
        executor.spin_once(0)
    assert seen == [clock.ns]


def test_a_late_call_does_not_shift_the_next_one(executor, fake, clock):
    timer = fake.timer(1, None, clock)
    assert calls_of(executor, clock, timer, 4.2, step=0.7) == [1.4, 2.1, 3.5, 4.2]


def test_a_period_of_zero_is_always_due(executor, fake, clock):
    seen = []
    fake.timer(0, lambda: seen.append(1), clock)
    for _ in range(3):
        executor.spin_once(0)
    assert len(seen) == 3


def test_a_cancelled_timer_is_silent_until_it_is_reset(executor, fake, clock):
    timer = fake.timer(1, None, clock)
    timer.cancel()
    assert timer.is_canceled()
    assert timer.time_until_next_call() is None
    assert calls_of(executor, clock, timer, 2) == []
    timer.reset()
    assert not timer.is_canceled()
    assert calls_of(executor, clock, timer, 1.5) == [3.0]


def test_without_autostart_it_waits_for_a_reset(context, clock):
    timer = Timer(None, None, 10**9, clock, context=context, autostart=False)
    assert timer.is_canceled()
    timer.reset()
    assert not timer.is_canceled()


def test_timer_returns_the_time_since_the_last_and_until_the_next_call(fake, clock):
    timer = fake.timer(1, None, clock)
    clock.go_on(0.25)
    assert timer.time_until_next_call() == 75 * 10**7
    assert timer.time_since_last_call() == 25 * 10**7
    assert not timer.is_ready()
    clock.go_on(1)
    assert timer.is_ready()
    assert timer.time_until_next_call() == -25 * 10**7


def test_a_new_period_counts_from_the_next_call_on(executor, fake, clock):
    timer = fake.timer(1, None, clock)
    timer.timer_period_ns = 2 * 10**9
    assert timer.timer_period_ns == 2 * 10**9
    assert calls_of(executor, clock, timer, 5.5) == [1.0, 3.0, 5.0]


def test_a_negative_period_is_refused(fake, clock):
    with pytest.raises(RCLError, match="must be non-negative"):
        fake.timer(-1, None, clock)


def test_a_period_of_more_than_63_bits_is_refused(fake, clock):
    with pytest.raises(TypeError, match=r"expected a period below 2\*\*63 ns"):
        fake.timer(2**63 / 10**9, None, clock)


def test_a_destroyed_timer_is_silent_and_cannot_be_used(executor, fake, clock):
    with fake.timer(1, None, clock) as timer:
        pass
    assert calls_of(executor, clock, timer, 2) == []
    with pytest.raises(InvalidHandle):
        timer.reset()


@pytest.mark.parametrize("wrap", [lambda call: call, functools.partial])
def test_callback_with_a_timer_info_parameter_gets_the_time_it_was_due(executor, fake, clock, wrap):
    seen = []

    def callback(info: TimerInfo):
        seen.append(info)

    del callback.__annotations__["info"]
    callback.__annotations__["info"] = TimerInfo
    fake.timer(1, wrap(callback), clock)
    clock.go_on(1.5)
    executor.spin_once(0)
    assert seen[0].expected_call_time == Time(seconds=1, clock_type=ClockType.STEADY_TIME)
    assert seen[0].actual_call_time == Time(seconds=1.5, clock_type=ClockType.STEADY_TIME)


def test_timer_info_checks_its_arguments():
    assert TimerInfo().expected_call_time == Time()
    with pytest.raises(TypeError, match="ClockType"):
        TimerInfo(clock_type="STEADY_TIME")
    with pytest.raises(ValueError, match="negative"):
        TimerInfo(actual_call_time=-1)


def simulated(seconds):
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(seconds=seconds))
    return clock


def test_a_timer_goes_by_simulated_time(executor, fake):
    clock, seen = simulated(10), []
    fake.timer(5, lambda: seen.append(clock.now().seconds_nanoseconds()[0]), clock)
    for second in (14, 15, 16, 19, 20):
        clock.set_ros_time_override(Time(seconds=second))
        executor.spin_once(0)
    assert seen == [15, 20]


def test_after_simulated_time_jumped_back_a_whole_period_passes(executor, fake):
    clock, seen = simulated(100), []
    fake.timer(5, lambda: seen.append(clock.now().seconds_nanoseconds()[0]), clock)
    for second in (1, 4, 5, 6):
        clock.set_ros_time_override(Time(seconds=second))
        executor.spin_once(0)
    assert seen == [6]


def test_what_is_left_of_a_period_survives_the_switch_to_simulated_time(fake):
    clock = simulated(100)
    timer = fake.timer(5, None, clock)
    clock.set_ros_time_override(Time(seconds=102))
    clock._set_ros_time_is_active(False)
    assert 2.9e9 < timer.time_until_next_call() <= 3e9


@pytest.mark.real_time
def test_simulated_time_wakes_a_sleeping_executor(executor, fake):
    clock, seen = simulated(0), threading.Event()
    fake.timer(5, seen.set, clock)
    thread = threading.Thread(target=executor.spin_once)
    thread.start()
    time.sleep(0.02)
    clock.set_ros_time_override(Time(seconds=5))
    thread.join(5)
    assert seen.is_set()


@pytest.mark.real_time
def test_spin_calls_a_real_timer_when_it_is_due_and_never_earlier(executor, fake):
    began, calls = time.perf_counter(), []
    timer = fake.timer(0.02, lambda: calls.append(time.perf_counter() - began))
    while len(calls) < 5:
        assert time.perf_counter() < began + 60
        is_due, before = timer.is_ready(), len(calls)
        executor.spin_once(0.002)
        assert len(calls) == before + 1 or not is_due
    assert all(at >= 0.02 * number for number, at in enumerate(calls, 1))


# Rates


def sleeping(rate):
    ends = []

    def sleep():
        try:
            ends.append(rate.sleep())
        except ROSInterruptException:
            ends.append("interrupted")

    thread = threading.Thread(target=sleep)
    thread.start()
    while rate._num_sleepers == 0:
        time.sleep(0.001)
    return thread, ends


@pytest.mark.real_time
def test_a_rate_sleeps_until_the_next_period(context, executor, fake):
    rate = Rate(fake.timer(0.01, None), context=context)
    thread, ends = sleeping(rate)
    executor.spin_once(5)
    thread.join(5)
    assert ends == [None]


@pytest.mark.real_time
@pytest.mark.parametrize("end", ["destroy", "shutdown"])
def test_destroying_a_rate_wakes_its_sleepers(context, fake, end):
    rate = Rate(fake.timer(1000, None), context=context)
    thread, ends = sleeping(rate)
    rate.destroy() if end == "destroy" else context.shutdown()
    thread.join(5)
    assert ends == [None if end == "destroy" else "interrupted"]
    with pytest.raises(RuntimeError if end == "destroy" else ROSInterruptException):
        rate.sleep()


def test_rate_whose_timer_was_destroyed_raises_invalid_handle(context, fake):
    rate = Rate(fake.timer(1, None), context=context)
    fake.timers[0].destroy()
    with pytest.raises(InvalidHandle, match="the timer has been destroyed"):
        rate.sleep()


def test_no_timer_is_created_after_the_shutdown(context, fake):
    context.shutdown()
    with pytest.raises(RCLError, match="the given context is not valid"):
        fake.timer(1, print)
