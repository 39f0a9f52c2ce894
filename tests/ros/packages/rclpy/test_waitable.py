"""Waitables: a program's own sources of work for a node."""

from __future__ import annotations

import pytest

from taskrpc.ros.packages.rclpy.callback_groups import (
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from taskrpc.ros.packages.rclpy.guard_condition import GuardCondition
from taskrpc.ros.packages.rclpy.task import Future
from taskrpc.ros.packages.rclpy.waitable import NumberOfEntities, Waitable


class Mailbox(Waitable):
    """A list of letters, each read once."""

    def __init__(self, group):
        super().__init__(group)
        self.letters = []
        self.read = []

    def is_ready(self, wait_set):
        return bool(self.letters)

    def take_data(self):
        return self.letters.pop(0)

    async def execute(self, taken_data):
        self.read.append(taken_data)


def test_an_executor_queries_takes_and_executes_a_waitable(executor, fake):
    mailbox = Mailbox(ReentrantCallbackGroup())
    fake.add_waitable(mailbox)
    executor.spin_once(0)
    mailbox.letters += ["one", "two"]
    executor.spin_once(0)
    assert mailbox.read == ["one"]
    executor.spin_once(0)
    assert mailbox.read == ["one", "two"]


def test_waitable_of_a_busy_exclusive_group_waits(executor, fake):
    group = MutuallyExclusiveCallbackGroup()
    mailbox = Mailbox(group)
    fake.add_waitable(mailbox)
    mailbox.letters.append("one")
    assert group.beginning_execution(mailbox)
    executor.spin_once(0)
    group.ending_execution(mailbox)
    assert mailbox.read == []
    executor.spin_once(0)
    assert mailbox.read == ["one"]


def test_executor_runs_the_done_callbacks_of_a_waitables_futures(executor, fake):
    mailbox, future, seen = Mailbox(ReentrantCallbackGroup()), Future(), []
    fake.add_waitable(mailbox)
    mailbox.add_future(future)
    mailbox.letters.append("one")
    executor.spin_once(0)
    future.add_done_callback(seen.append)
    future.set_result(None)
    assert seen == []
    executor.spin_once(0)
    assert seen == [future]
    mailbox.remove_future(future)
    assert mailbox._futures == []


def test_waitable_may_wait_for_a_guard_condition(context, executor, fake):
    class Bell(Waitable):
        rung = 0

        def __init__(self):
            super().__init__(ReentrantCallbackGroup())
            self.guard = GuardCondition(None, None, context)

        def add_to_wait_set(self, wait_set):
            self.index = wait_set.add_guard_condition(self.guard.handle)

        def is_ready(self, wait_set):
            return wait_set.is_ready("guard_condition", self.index)

        def take_data(self):
            return None

        async def execute(self, taken_data):
            self.rung += 1

    bell = Bell()
    fake.add_waitable(bell)
    executor.spin_once(0)
    assert bell.rung == 0
    state = executor._sleep.state
    bell.guard.trigger()
    assert executor._sleep.state is not state
    executor.spin_once(0)
    executor.spin_once(0)
    assert bell.rung == 1


def test_waitable_without_the_required_methods_is_refused():
    waitable = Waitable(ReentrantCallbackGroup())
    assert waitable.callback_group.has_entity(waitable)
    for ask in (lambda: waitable.is_ready(None), waitable.take_data):
        with pytest.raises(NotImplementedError):
            ask()


def test_numbers_of_entities_add_up():
    one, two = NumberOfEntities(1, 2, 3, 4, 5), NumberOfEntities(10, 20, 30, 40, 50)
    assert one + two == NumberOfEntities(11, 22, 33, 44, 55)
    assert NumberOfEntities(num_subs=1, num_gcs=2).num_guard_conditions == 2
    one += two
    assert one.num_clients == 44


def test_several_triggers_of_a_guard_condition_run_its_callback_once(executor, fake):
    seen = []
    guard = fake.guard(lambda: seen.append(1))
    executor.spin_once(0)
    guard.trigger()
    guard.trigger()
    executor.spin_once(0)
    executor.spin_once(0)
    assert seen == [1]


def test_guard_condition_without_a_callback_only_wakes_the_executor(context, executor):
    guard = GuardCondition(None, None, context)
    guard.trigger()
    assert guard.take_work() is None
    assert guard.take_work() is None
