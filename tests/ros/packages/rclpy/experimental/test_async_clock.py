"""Coroutines sleep on the clock of an AsyncNode, in real and in simulated time."""

import asyncio

import pytest

from taskrpc.ros.packages.rclpy.clock import ClockType
from taskrpc.ros.packages.rclpy.exceptions import TimeSourceChangedError
from taskrpc.ros.packages.rclpy.experimental import AsyncClock
from taskrpc.ros.packages.rclpy.time import Time


@pytest.fixture
def clock():
    """A clock that a simulation may set."""
    return AsyncClock(clock_type=ClockType.ROS_TIME)


def simulated(clock, seconds):
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))


async def begun(coroutine):
    task = asyncio.create_task(coroutine)
    await asyncio.sleep(0)
    return task


async def test_a_sleep_lasts_as_long_as_it_says(clock):
    loop = asyncio.get_running_loop()
    since = loop.time()
    await clock.sleep(3)
    assert loop.time() - since == pytest.approx(3)


@pytest.mark.parametrize("seconds", [0, -1.0])
async def test_a_sleep_of_no_time_ends_at_once(clock, seconds):
    await clock.sleep(seconds)


async def test_simulated_time_wakes_the_sleeps_that_it_has_passed(clock):
    simulated(clock, 10)
    short, long = await begun(clock.sleep(1)), await begun(clock.sleep(5))
    await asyncio.sleep(100)
    assert not short.done()
    simulated(clock, 11)
    await short
    assert not long.done()
    simulated(clock, 15)
    await long


@pytest.mark.parametrize("before", [False, True])
async def test_switching_simulated_time_ends_a_sleep(clock, before):
    clock._set_ros_time_is_active(before)
    sleeping = await begun(clock.sleep(5))
    clock._set_ros_time_is_active(not before)
    with pytest.raises(TimeSourceChangedError, match="switched on or off"):
        await sleeping


async def test_destroy_cancels_sleeps_and_refuses_new_ones(clock):
    sleeping = await begun(clock.sleep(5))
    clock.destroy()
    clock.destroy()
    with pytest.raises(asyncio.CancelledError):
        await sleeping
    with pytest.raises(RuntimeError, match="destroyed clock"):
        await clock.sleep(1)


def test_it_has_the_time_of_its_kind():
    steady = AsyncClock(clock_type=ClockType.STEADY_TIME)
    assert steady.clock_type is ClockType.STEADY_TIME
    assert steady.now().nanoseconds < AsyncClock().now().nanoseconds
    assert AsyncClock().clock_type is ClockType.SYSTEM_TIME
