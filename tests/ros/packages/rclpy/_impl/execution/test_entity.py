"""The callback that runs on a thread is known."""

from __future__ import annotations

from taskrpc.ros.packages.rclpy.callback_groups import (
    ReentrantCallbackGroup,
)
from taskrpc.ros.packages.rclpy.executors import (
    current_callback,
)


def test_the_callback_that_runs_on_a_thread_is_known(executor, fake):
    seen = []
    guard = fake.guard(lambda: seen.append(current_callback()))
    assert current_callback() is None
    guard.trigger()
    executor.spin_once(0)
    executor.create_task(lambda: seen.append(current_callback()))
    executor.spin_once(0)
    assert [(each.entity, each.executor) for each in seen] == [(guard, executor), (None, executor)]
    assert current_callback() is None


def test_a_callback_that_spins_is_the_outer_one_again_afterwards(executor, fake):
    seen = []
    inner = fake.guard(lambda: seen.append(current_callback().entity), ReentrantCallbackGroup())

    def nested():
        inner.trigger()
        executor.spin_once(0)
        seen.append(current_callback().entity)

    outer = fake.guard(nested)
    outer.trigger()
    executor.spin_once(0)
    assert seen == [inner, outer]


def test_a_task_that_spins_is_the_outer_callback_again_afterwards(executor, fake):
    seen = []

    def nested():
        executor.create_task(lambda: seen.append(current_callback().entity))
        executor.spin_once(0)
        seen.append(current_callback().entity)

    outer = fake.guard(nested)
    outer.trigger()
    executor.spin_once(0)
    assert seen == [None, outer]
