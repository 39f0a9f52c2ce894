"""Timers: cancel, reset, periods, one-shot timers, destruction and rates."""

import time

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.timer import TimerInfo
from shared import Robot, attempt, end, fails


def calls(robot, timer, told, what, seconds):
    """Print how often a timer was called."""
    robot.spin(seconds)
    print(f"{what}: {len(told)} calls, canceled {timer.is_canceled()}", flush=True)
    told.clear()


def lives(robot):
    told = []
    timer = robot.node.create_timer(0.2, lambda: told.append(1))
    calls(robot, timer, told, "started", 0.5)
    timer.cancel()
    calls(robot, timer, told, "canceled", 0.5)
    attempt("ready", timer.is_ready)
    attempt("until next while canceled", timer.time_until_next_call)
    timer.cancel()
    timer.reset()
    attempt("until next after reset", lambda: 0.15e9 < timer.time_until_next_call() <= 0.2e9)
    calls(robot, timer, told, "reset", 0.5)
    timer.timer_period_ns = 100_000_000
    attempt("period", lambda: timer.timer_period_ns)
    timer.reset()
    calls(robot, timer, told, "twice as fast", 0.56)
    time.sleep(0.75)
    robot.executor.spin_once(timeout_sec=0)
    robot.executor.spin_once(timeout_sec=0)
    print("after a break", len(told), flush=True)
    timer.callback = lambda: told.append("other")
    told.clear()
    robot.spin(0.2)
    print("other callback", set(told), flush=True)
    attempt("destroy", lambda: robot.node.destroy_timer(timer))
    attempt("destroy again", lambda: robot.node.destroy_timer(timer))
    for name in ("cancel", "reset", "is_canceled", "is_ready", "time_until_next_call"):
        attempt(f"destroyed {name}", getattr(timer, name))
    attempt("destroyed period", lambda: timer.timer_period_ns)


def kinds(robot):
    node, told = robot.node, []

    def once():
        told.append(1)
        timer.cancel()

    timer = node.create_timer(0.05, once)
    calls(robot, timer, told, "one-shot", 0.4)
    timer = node.create_timer(0.05, lambda: told.append(1), autostart=False)
    calls(robot, timer, told, "not started", 0.3)
    timer.reset()
    robot.until(lambda: told)
    timer.cancel()
    print("started later", bool(told), timer.is_canceled(), flush=True)
    told.clear()
    infos = []

    def with_info(info: TimerInfo):
        infos.append(type(info).__name__)

    timer = node.create_timer(0.05, with_info)
    robot.until(lambda: infos)
    print("info", infos[0], flush=True)
    node.destroy_timer(timer)

    def removes():
        told.append(1)
        node.destroy_timer(timer)

    timer = node.create_timer(0.05, removes)
    robot.spin(0.3)
    print("destroys itself", len(told), flush=True)
    told.clear()

    async def later():
        told.append("async")

    timer = node.create_timer(0.05, later)
    robot.until(lambda: told)
    print("async", told[0], flush=True)
    node.destroy_timer(timer)


def arguments(robot):
    create = robot.node.create_timer
    for what, period in {
        "negative": -1.0,
        "zero": 0,
        "text": "1",
        "none": None,
        "large": 1e12,
        "bool": True,
    }.items():
        fails(f"period {what}", lambda period=period: create(period, None).timer_period_ns)
    fails("no callable", lambda: create(1.0, 5).is_canceled())
    fails("other clock", lambda: create(1.0, None, clock=5))
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    attempt("clock", lambda: create(1.0, None, clock=steady).clock is steady)
    fails("rate of 0", lambda: robot.node.create_rate(0))
    fails("negative rate", lambda: robot.node.create_rate(-1))
    fails("rate of a text", lambda: robot.node.create_rate("5"))
    attempt("timers", lambda: len(list(robot.node.timers)) > 0)


rclpy.init()
robot = Robot()
lives(robot)
kinds(robot)
arguments(robot)
end()
