"""Executors: which callbacks they run, in which order and thread, and how they end."""

from __future__ import annotations

import asyncio
import os
import threading
import time

import pytest

from taskrpc.ros.packages.rclpy._impl.execution.wakeups import Sleep
from taskrpc.ros.packages.rclpy.callback_groups import (
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.exceptions import InvalidHandle
from taskrpc.ros.packages.rclpy.executors import (
    ConditionReachedException,
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
    TimeoutObject,
    await_or_execute,
)
from taskrpc.ros.packages.rclpy.experimental import EventsExecutor
from taskrpc.ros.packages.rclpy.task import Future
from taskrpc.ros.packages.rclpy.waitable import Waitable
from tests.ros.packages.rclpy.fakes import FakeNode


@pytest.fixture
def pool(context, fake):
    with MultiThreadedExecutor(4, context=context) as pool:
        pool.add_node(fake)
        yield pool


def spin_until(executor, condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        executor.spin_once(0.05)


# One callback at a time


def test_spin_once_without_work_returns_at_the_timeout(executor):
    executor.spin_once(0)
    executor.spin_once(timeout_sec=0.001)
    executor.spin_once(TimeoutObject(0.001))


def test_spin_once_runs_one_callback(executor, fake):
    seen = []
    one, two = fake.guard(lambda: seen.append(1)), fake.guard(lambda: seen.append(2))
    one.trigger()
    two.trigger()
    executor.spin_once(0)
    assert seen == [1]
    executor.spin_once(0)
    assert seen == [1, 2]
    executor.spin_once(0)
    assert seen == [1, 2]


def test_each_ready_callback_runs_once_before_any_runs_twice(executor, fake):
    seen = []

    def busy():
        seen.append("busy")
        always.trigger()

    always, other = fake.guard(busy), fake.guard(lambda: seen.append("other"))
    always.trigger()
    other.trigger()
    for _ in range(3):
        executor.spin_once(0)
    assert seen == ["busy", "other", "busy"]


def test_timers_come_before_guard_conditions_and_waitables_before_both(executor, fake):
    seen = []

    class Own(Waitable):
        there = True

        def is_ready(self, wait_set):
            return self.there

        def take_data(self):
            self.there = False
            return "data"

        async def execute(self, taken_data):
            seen.append(taken_data)

    fake.guard(lambda: seen.append("guard")).trigger()
    fake.timer(0, lambda: (seen.append("timer"), fake.timers[0].cancel()))
    fake.add_waitable(Own(ReentrantCallbackGroup()))
    for _ in range(4):
        executor.spin_once(0)
    assert seen == ["data", "timer", "guard"]


def test_an_exception_of_a_callback_leaves_spin_and_other_work_runs_later(executor, fake):
    seen = []
    fake.guard(lambda: 1 / 0).trigger()
    fake.guard(lambda: seen.append(1)).trigger()
    with pytest.raises(ZeroDivisionError):
        executor.spin()
    executor.spin_once(0)
    assert seen == [1]


def test_an_exit_in_a_callback_leaves_spin_and_frees_its_group(executor, fake):
    guard = fake.guard(lambda: exit(2))
    guard.trigger()
    with pytest.raises(SystemExit):
        executor.spin()
    assert fake.group.can_execute(guard)


def test_a_destroyed_guard_condition_is_silent(executor, fake):
    guard = fake.guard(lambda: pytest.fail("it was destroyed"))
    guard.trigger()
    guard.destroy()
    executor.spin_once(0)
    with pytest.raises(InvalidHandle, match="destruction was requested"):
        guard.trigger()


# Coroutines


def test_suspended_coroutine_callback_continues_in_a_later_round(executor, fake):
    seen = []

    async def callback():
        seen.append("began")
        await asyncio.sleep(0)
        seen.append("went on")

    fake.guard(callback).trigger()
    executor.spin_once(0)
    assert seen == ["began"]
    executor.spin_once(0)
    assert seen == ["began", "went on"]


def test_a_coroutine_that_waits_holds_its_exclusive_group(executor, fake):
    future, seen = Future(), []

    async def callback():
        await future

    fake.guard(callback).trigger()
    executor.spin_once(0)
    fake.guard(lambda: seen.append(1)).trigger()
    executor.spin_once(0)
    assert seen == []
    future.set_result(None)
    executor.spin_once(0)
    executor.spin_once(0)
    assert seen == [1]


def test_in_a_reentrant_group_others_run_while_a_coroutine_waits(executor, fake):
    group, future, seen = ReentrantCallbackGroup(), Future(), []

    async def callback():
        seen.append(await future)

    fake.guard(callback, group).trigger()
    fake.guard(lambda: future.set_result("answer"), group).trigger()
    for _ in range(3):
        executor.spin_once(0)
    assert seen == ["answer"]


def test_an_exception_of_a_coroutine_after_an_await_leaves_spin(executor, fake):
    async def callback():
        await asyncio.sleep(0)
        raise ValueError("late")

    guard = fake.guard(callback)
    guard.trigger()
    with pytest.raises(ValueError, match="late"):
        executor.spin()
    assert fake.group.can_execute(guard)


async def test_coroutine_callbacks_run_when_a_program_spins_inside_asyncio(executor, fake):
    future, seen = Future(), []

    async def callback():
        seen.append(await future)

    fake.guard(callback).trigger()
    executor.spin_once(0)
    future.set_result("answer")
    executor.spin_once(0)
    await asyncio.sleep(0)
    assert seen == ["answer"]


def test_coroutine_callback_that_spins_is_not_entered_again(executor, fake):
    inner, outer, seen = Future(), Future(), []

    async def nested():
        seen.append(await inner)

    async def callback():
        fake.guard(nested, ReentrantCallbackGroup()).trigger()
        executor.spin_once(0)
        seen.append(await outer)

    fake.guard(callback).trigger()
    executor.spin_once(0)
    outer.set_result("outer")
    executor.spin_once(0)
    inner.set_result("inner")
    executor.spin_once(0)
    assert seen == ["outer", "inner"]


def test_a_coroutine_that_always_yields_starves_no_other_work(executor, fake):
    seen = []

    async def callback():
        while not seen:
            await asyncio.sleep(0)

    fake.guard(callback, ReentrantCallbackGroup()).trigger()
    executor.spin_once(0)
    fake.guard(lambda: seen.append(1)).trigger()
    spin_until(executor, lambda: seen)


# Tasks


def test_a_task_runs_when_a_thread_spins(executor):
    task = executor.create_task(lambda a, b: a + b, 1, b=2)
    assert not task.done()
    executor.spin_once(0)
    assert task.result() == 3


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, EventsExecutor])
def test_tasks_run_in_the_order_in_which_they_were_created(context, kind):
    executor, seen = kind(context=context), []
    for letter in "abc":
        executor.create_task(seen.append, letter)
    for _ in range(3):
        executor.spin_once(0)
    assert "".join(seen) == "abc"


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, EventsExecutor])
def test_a_task_that_awaits_another_goes_on_in_the_round_after_it(context, kind):
    executor = kind(context=context)

    async def first():
        return await made[second]

    async def second():
        return "second"

    made = {each: executor.create_task(each) for each in (first, second)}
    executor.spin_once(0)
    executor.spin_once(0)
    assert (made[first].done(), made[second].done()) == (False, True)
    executor.spin_once(1)
    assert made[first].result() == "second"


def test_a_cancelled_task_does_not_run(executor):
    async def coroutine():
        pytest.fail("it was cancelled")

    task = executor.create_task(coroutine)
    task.cancel()
    executor.spin_until_future_complete(task)
    executor.spin_once(0)
    assert (task.done(), task.cancelled(), task.result()) == (False, True, None)


def test_an_exception_of_a_task_leaves_spin(executor):
    executor.create_task(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        executor.spin_once(0)


async def test_await_or_execute_takes_both_kinds_of_functions():
    async def coroutine(number):
        return number

    assert await await_or_execute(coroutine, 1) == 1
    assert await await_or_execute(lambda number: number, 2) == 2


# Spinning for a future


def test_spinning_for_a_future_that_is_done_returns_at_once(executor):
    future = Future()
    future.set_result(1)
    executor.spin_until_future_complete(future)


def test_spinning_for_a_future_without_waiting_leaves_it_pending(executor):
    future = Future()
    executor.spin_until_future_complete(future, timeout_sec=0)
    assert not future.done()


@pytest.mark.real_time
@pytest.mark.parametrize("timeout", [None, -1, 5])
def test_a_future_completed_by_another_thread_ends_the_spinning(executor, timeout):
    future = executor.create_future()
    threading.Timer(0.01, future.set_result, ["there"]).start()
    executor.spin_until_future_complete(future, timeout)
    assert future.result() == "there"


@pytest.mark.real_time
def test_the_timeout_ends_the_spinning_not_before_its_time(executor, fake):
    fake.timer(0.003, lambda: None)
    begin = time.perf_counter()
    executor.spin_until_future_complete(Future(), timeout_sec=0.05)
    assert time.perf_counter() - begin >= 0.05


def test_spinning_accepts_any_future_and_refuses_other_objects(executor):
    from concurrent.futures import Future as Other

    other = Other()
    executor.create_task(other.set_result, 3)
    executor.spin_until_future_complete(other, timeout_sec=10)
    assert other.result(0) == 3
    with pytest.raises(AttributeError, match="'list' object has no attribute 'add_done_callback'"):
        executor.spin_until_future_complete([])


def test_spinning_many_times_for_one_future_leaves_one_waiter(executor):
    future = Future()
    for _ in range(10):
        executor.spin_until_future_complete(future, timeout_sec=0)
        executor.spin_once_until_future_complete(future, 0)
    assert len(future._waiters) == 1


@pytest.mark.real_time
@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_a_future_cancelled_by_another_thread_ends_the_spinning(context, kind):
    with kind(context=context) as executor:
        future = Future()
        threading.Timer(0.02, future.cancel).start()
        executor.spin_until_future_complete(future)
        assert future.cancelled()


# The events executor


@pytest.fixture
def events(context, fake):
    with EventsExecutor(context=context) as events:
        events.add_node(fake)
        yield events


def test_awaiting_callback_delays_no_other_callback_in_the_events_executor(events, fake):
    future, seen = Future(), []

    async def wait():
        seen.append(await future)

    fake.guard(wait).trigger()
    fake.guard(lambda: future.set_result("answer")).trigger()
    events.spin_until_future_complete(Future(), 0)
    assert seen == ["answer"]
    assert fake.group.can_execute(fake.guards[0])


def test_events_executor_runs_all_ready_callbacks_before_it_checks_its_timeout(events, fake):
    seen = []
    later = fake.guard(lambda: seen.append("later"))
    fake.guard(lambda: (seen.append("first"), later.trigger())).trigger()
    events.spin_until_future_complete(Future(), 0)
    assert seen == ["first", "later"]
    later.trigger()
    events.spin_until_future_complete(future := events.create_task(lambda: 3), 0)
    assert future.result() == 3


# Nodes


def test_a_node_is_added_once_and_belongs_to_the_executor(executor, fake):
    assert fake.executor is executor
    assert not executor.add_node(fake)
    assert executor.get_nodes() == [fake]


def test_a_removed_node_is_not_served(executor, fake):
    guard = fake.guard(lambda: pytest.fail("its node was removed"))
    guard.trigger()
    executor.remove_node(fake)
    executor.spin_once(0)
    assert executor.get_nodes() == []


def test_a_node_removed_in_the_middle_of_a_round_is_not_served(executor, fake):
    fake.guard(lambda: executor.remove_node(fake)).trigger()
    fake.guard(lambda: pytest.fail("its node was removed")).trigger()
    executor.spin_once(0)
    executor.spin_once(0)


def test_a_task_of_a_node_that_was_removed_waits_until_the_node_is_back(context, executor, fake):
    seen = []

    async def callback():
        await asyncio.sleep(0)
        seen.append("went on")

    fake.guard(callback).trigger()
    executor.spin_once(0)
    executor.remove_node(fake)
    executor.add_node(other := FakeNode(context))
    other.guard(lambda: seen.append("other")).trigger()
    for _ in range(3):
        executor.spin_once(0)
    assert seen == ["other"]
    executor.add_node(fake)
    executor.spin_once(0)
    assert seen == ["other", "went on"]


def test_entities_that_are_created_later_are_served(executor, fake):
    executor.spin_once(0)
    seen = []
    fake.guard(lambda: seen.append(1)).trigger()
    executor.spin_once(0)
    assert seen == [1]


@pytest.mark.real_time
def test_new_work_and_new_nodes_wake_a_sleeping_executor(context, fake):
    executor = SingleThreadedExecutor(context=context)
    seen = threading.Event()
    guard = fake.guard(seen.set)
    thread = threading.Thread(target=executor.spin_once)
    thread.start()
    time.sleep(0.02)
    guard.trigger()
    executor.add_node(fake)
    thread.join(5)
    assert seen.is_set()
    thread = threading.Thread(target=executor.spin_once)
    thread.start()
    time.sleep(0.02)
    seen.clear()
    guard.trigger()
    thread.join(5)
    assert seen.is_set()


@pytest.mark.real_time
def test_is_spinning_is_true_while_a_thread_waits_or_runs_a_callback(executor, fake):
    seen = []
    assert not executor.is_spinning
    guard = fake.guard(lambda: seen.append(executor.is_spinning))
    thread = threading.Thread(target=executor.spin_once)
    thread.start()
    while not executor.is_spinning:
        time.sleep(0.001)
    guard.trigger()
    thread.join(5)
    assert (seen, executor.is_spinning) == ([True], False)


# Ends


def test_an_executor_needs_a_context_that_was_initialised():
    with pytest.raises(RuntimeError, match="must be initialized before an executor"):
        SingleThreadedExecutor(context=Context())


def test_spin_of_a_pool_ends_when_its_threads_have_ended(pool, fake):
    """This happens at the end of a program while a daemon thread spins."""
    pool._executor.shutdown()
    fake.guard(lambda: None).trigger()
    pool.spin()


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_an_executor_that_was_shut_down_has_no_work(context, kind):
    executor = kind(context=context)
    work = executor._wait_for_ready_callbacks()
    executor.shutdown()
    with pytest.raises(ShutdownException):
        executor.wait_for_ready_callbacks()
    with pytest.raises(ShutdownException):
        next(work)
    executor.spin()
    assert executor.shutdown()


def test_waiting_without_work_raises_an_exception_for_the_reason(executor):
    with pytest.raises(TimeoutException):
        executor.wait_for_ready_callbacks(timeout_sec=0)
    with pytest.raises(ConditionReachedException):
        executor.wait_for_ready_callbacks(condition=lambda: True)


def test_custom_executor_gets_work_from_wait_for_ready_callbacks(context, fake):
    class Own(Executor):
        def spin_once(self, timeout_sec=None):
            task, self.entity, self.node = self.wait_for_ready_callbacks(timeout_sec)
            task()

    executor, seen = Own(context=context), []
    executor.add_node(fake)
    guard = fake.guard(lambda: seen.append(1))
    guard.trigger()
    executor.spin_once(0)
    assert (seen, executor.entity, executor.node) == ([1], guard, fake)
    executor.create_task(seen.append, 2)
    executor.spin_once(0)
    assert seen == [1, 2]


def test_custom_executor_gets_unfinished_work_only_once(executor, fake):
    executor.add_node(fake)
    fake.guard(lambda: None).trigger()
    task, _, _ = executor.wait_for_ready_callbacks(timeout_sec=0)
    with pytest.raises(TimeoutException):
        executor.wait_for_ready_callbacks(timeout_sec=0)
    task()


def test_wait_for_ready_callbacks_can_be_limited_to_some_nodes(context, executor, fake):
    other, seen = FakeNode(context), []
    executor.add_node(other)
    fake.guard(lambda: seen.append("first")).trigger()
    other.guard(lambda: seen.append("second")).trigger()
    task, _, node = executor.wait_for_ready_callbacks(0, [other])
    task()
    assert (seen, node) == (["second"], other)


def test_context_shutdown_ends_spin_with_an_exception_unless_a_callback_shut_it_down(context, fake):
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(fake)
    fake.guard(context.shutdown).trigger()
    executor.spin()
    with pytest.raises(ExternalShutdownException):
        executor.spin_once()


@pytest.mark.real_time
@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_the_shutdown_of_the_context_wakes_the_spinning_thread(kind):
    context = Context()
    context.init([])
    executor, ends, spinning = kind(context=context), [], threading.Event()
    executor.create_task(spinning.set)

    def spin():
        try:
            executor.spin()
            ends.append("returned")
        except ExternalShutdownException:
            ends.append("raised")

    thread = threading.Thread(target=spin)
    thread.start()
    spinning.wait(60)
    time.sleep(0.02)
    context.shutdown()
    thread.join(5)
    executor.shutdown()
    assert ends == ["raised" if kind is SingleThreadedExecutor else "returned"]


@pytest.mark.real_time
def test_a_shutdown_wakes_the_spinning_thread(executor, fake):
    fake.timer(10, lambda: None)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    executor.shutdown()
    thread.join(5)
    assert not thread.is_alive()


def test_a_callback_may_shut_its_executor_down(executor, fake):
    fake.guard(executor.shutdown).trigger()
    executor.spin()


def test_leaving_the_with_block_shuts_down(context):
    with SingleThreadedExecutor(context=context) as executor:
        assert not executor._is_shutdown
    assert executor._is_shutdown


# Threads


@pytest.mark.real_time
def test_a_pool_runs_callbacks_of_several_groups_at_once(pool, fake):
    both = threading.Barrier(2, timeout=60)
    done = []

    def meet():
        both.wait()
        done.append(threading.get_ident())

    fake.guard(meet, MutuallyExclusiveCallbackGroup()).trigger()
    fake.guard(meet, MutuallyExclusiveCallbackGroup()).trigger()
    spin_until(pool, lambda: len(done) == 2)
    assert len(set(done)) == 2


@pytest.mark.real_time
def test_pool_runs_all_data_of_one_reentrant_entity_at_the_same_time(pool, fake):
    together, met = threading.Barrier(3, timeout=60), Future()

    class Queue(Waitable):
        def __init__(self):
            super().__init__(ReentrantCallbackGroup())
            self.items = [1, 2, 3]

        def is_ready(self, wait_set):
            return bool(self.items)

        def take_data(self):
            time.sleep(0.01)  # the spinning thread goes to sleep meanwhile
            return self.items.pop()

        async def execute(self, taken_data):
            together.wait()
            met.set_result(None)

    fake.add_waitable(Queue())
    pool.spin_until_future_complete(met)


@pytest.mark.real_time
def test_a_pool_runs_one_callback_of_an_exclusive_group_at_a_time(pool, fake):
    inside, seen = threading.Lock(), []

    def alone():
        assert inside.acquire(blocking=False), "two at once"
        time.sleep(0.01)
        inside.release()
        seen.append(1)

    guards = [fake.guard(alone) for _ in range(4)]
    for guard in guards:
        guard.trigger()
    spin_until(pool, lambda: len(seen) == 4)


@pytest.mark.real_time
def test_an_exception_of_a_callback_in_a_pool_leaves_spin(pool, fake):
    guard = fake.guard(lambda: 1 / 0)
    for _ in range(2):
        guard.trigger()
        with pytest.raises(ZeroDivisionError):
            pool.spin()


@pytest.mark.real_time
def test_a_task_that_was_chosen_while_a_callback_failed_runs_later(context):
    gate, after_the_failure, seen = threading.Event(), threading.Event(), []

    def fail():
        gate.wait(60)
        raise ZeroDivisionError

    class Failing:
        """A future that lets the callback fail at the second check of `done`."""

        asked = 0

        def add_done_callback(self, callback):
            pass

        def cancelled(self):
            return False

        def done(self):
            self.asked += 1
            if self.asked == 2:  # the first time the executor only collects what is ready
                gate.set()
                assert after_the_failure.wait(60)
            return False

    with pytest.warns(UserWarning, match="single thread"):
        pool = MultiThreadedExecutor(1, context=context)
    with pool:
        for task in (fail, after_the_failure.set):  # one after the other, on the pool's one thread
            pool.create_task(task)
            pool.spin_once(0)
        pool.create_task(seen.append, "ran")
        with pytest.raises(ZeroDivisionError):
            pool.spin_once_until_future_complete(Failing(), 0)
        assert not seen
        spin_until(pool, lambda: seen)
    assert seen == ["ran"]


@pytest.mark.real_time
def test_an_exit_in_a_pool_leaves_spin(pool, fake):
    fake.guard(lambda: exit(3)).trigger()
    with pytest.raises(SystemExit):
        pool.spin()


@pytest.mark.real_time
def test_a_coroutine_in_a_pool_is_resumed_by_a_future_of_another_thread(pool, fake):
    future, seen = Future(), []

    async def wait():
        seen.append(await future)

    fake.guard(wait).trigger()
    threading.Timer(0.02, future.set_result, ["here"]).start()
    spin_until(pool, lambda: seen)
    assert seen == ["here"]


@pytest.mark.real_time
def test_a_callback_may_shut_its_pool_down(context, fake):
    pool = MultiThreadedExecutor(2, context=context)
    pool.add_node(fake)
    fake.guard(pool.shutdown).trigger()
    pool.spin()
    assert not pool.spin_once(0)


def test_pool_with_one_thread_warns(context):
    with pytest.warns(UserWarning, match="Use the SingleThreadedExecutor instead"):
        MultiThreadedExecutor(1, context=context).shutdown()


def test_two_threads_may_spin_one_executor(executor, fake):
    seen = []
    for _ in range(50):
        fake.guard(lambda: seen.append(threading.get_ident()), ReentrantCallbackGroup()).trigger()
    threads = [
        threading.Thread(target=lambda: [executor.spin_once(0) for _ in range(50)])
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 50


# What explains deadlocks


def test_ready_callbacks_can_be_iterated_over_for_some_nodes_only(context, executor, fake):
    seen = []
    executor.add_node(other := FakeNode(context))
    fake.guard(lambda: seen.append("fake")).trigger()
    other.guard(lambda: seen.append("other")).trigger()
    ready = executor._wait_for_ready_callbacks(0, [other])
    task, _, node = next(ready)
    task()
    assert (node, seen) == (other, ["other"])
    with pytest.raises(TimeoutException):
        next(ready)


@pytest.mark.real_time
@pytest.mark.parametrize("ends", [lambda future: future.set_result(1), lambda f: f.cancel()])
def test_another_kind_of_future_ends_the_spinning_from_another_thread(executor, ends):
    from concurrent.futures import Future as Other

    other, began = Other(), time.monotonic()
    timer = threading.Timer(0.02, ends, [other])
    timer.start()
    executor.spin_until_future_complete(other, timeout_sec=10)
    assert time.monotonic() - began < 5
    timer.join()


def test_spinning_without_waiting_does_not_wait(executor, monkeypatch):
    waits = []
    monkeypatch.setattr(Sleep, "until_ended", lambda self, seen, seconds: waits.append(seconds))
    executor.spin_until_future_complete(Future(), timeout_sec=0)
    assert set(waits) <= {0}


@pytest.mark.real_time
def test_a_pool_spins_for_a_future_no_longer_than_its_timeout(pool):
    began = time.monotonic()
    pool.spin_once_until_future_complete(Future(), 0.02)
    assert time.monotonic() - began < 5


@pytest.mark.real_time
def test_a_task_goes_on_when_its_node_is_added_while_the_executor_sleeps(executor, fake):
    seen = []

    async def callback():
        await asyncio.sleep(0)
        seen.append("went on")

    fake.guard(callback).trigger()
    executor.spin_once(0)
    executor.remove_node(fake)
    executor.spin_once(0)
    threading.Timer(0.05, executor.add_node, [fake]).start()
    began = time.monotonic()
    executor.spin_once(10)
    assert seen == ["went on"]
    assert time.monotonic() - began < 5


def test_a_pool_has_a_thread_for_each_processor(context, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0}, raising=False)
    with pytest.warns(UserWarning, match="single thread"):
        MultiThreadedExecutor(context=context).shutdown()
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    with pytest.warns(UserWarning, match="single thread"):
        MultiThreadedExecutor(context=context).shutdown()
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    MultiThreadedExecutor(context=context).shutdown()
