"""A timer of an AsyncNode calls back periodically, in real and in simulated time."""

import asyncio

import pytest

from taskrpc.ros.packages.rclpy.clock import ClockType
from taskrpc.ros.packages.rclpy.parameter import Parameter
from taskrpc.ros.packages.rclpy.time import Time
from taskrpc.ros.packages.rclpy.timer import TimerInfo

pytestmark = pytest.mark.real_time


class Counter:
    def __init__(self):
        self.count = 0
        self.counted = asyncio.Event()

    async def __call__(self):
        self.count += 1
        self.counted.set()

    async def next(self):
        self.counted.clear()
        await self.counted.wait()


async def test_it_calls_back_again_and_again(create):
    counter = Counter()
    async with create() as node:
        node.create_timer(0.001, counter)
        for _ in range(3):
            await counter.next()


async def test_a_cancelled_timer_continues_after_reset(create):
    counter = Counter()
    async with create() as node:
        timer = node.create_timer(0.001, counter)
        await counter.next()
        timer.cancel()
        count = counter.count
        await asyncio.sleep(0.01)
        assert counter.count == count
        timer.reset()
        await counter.next()


async def test_it_begins_with_reset_without_autostart(create):
    counter = Counter()
    async with create() as node:
        timer = node.create_timer(0.001, counter, autostart=False)
        await asyncio.sleep(0.01)
        assert counter.count == 0
        timer.reset()
        await counter.next()


async def test_a_destroyed_timer_calls_back_no_more(create):
    counter = Counter()
    async with create() as node:
        timer = node.create_timer(0.001, counter)
        await counter.next()
        timer.destroy()
        timer.destroy()
        count = counter.count
        await asyncio.sleep(0.01)
        assert counter.count == count


async def test_a_period_of_zero_leaves_time_for_other_tasks(create):
    counter = Counter()
    async with create() as node:
        node.create_timer(0, counter)
        for _ in range(3):
            await counter.next()


async def test_an_exception_of_the_callback_ends_the_node(create):
    def callback():
        raise ValueError("late")

    node = create()
    node.create_timer(0.001, callback)
    with pytest.raises(ExceptionGroup) as raised:
        await node.run()
    assert raised.group_contains(ValueError)


async def test_a_callback_with_a_parameter_gets_the_info(create):
    infos = asyncio.Queue()
    async with create() as node:
        node.create_timer(0.001, lambda info: infos.put_nowait(info))
        assert isinstance(await infos.get(), TimerInfo)


async def test_a_callback_with_two_parameters_is_refused(create):
    with pytest.raises(RuntimeError, match="zero arguments or one argument"):
        create().create_timer(1, lambda a, b: None)


async def test_simulated_time_makes_it_due(create):
    counter = Counter()
    settings = {"parameter_overrides": [Parameter("use_sim_time", value=True)]}
    async with create(**settings) as node:
        node.get_clock().set_ros_time_override(Time(clock_type=ClockType.ROS_TIME))
        node.create_timer(1, counter)
        await asyncio.sleep(0.01)
        assert counter.count == 0
        node.get_clock().set_ros_time_override(Time(seconds=1, clock_type=ClockType.ROS_TIME))
        await counter.next()
        assert counter.count == 1
