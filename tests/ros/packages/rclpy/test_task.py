"""Futures and tasks behave as in ROS: a pending future has no result, a task runs when called."""

from __future__ import annotations

import asyncio
import gc
import threading

import pytest

from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.task import Future, FutureState, Task


def test_a_pending_future_has_neither_result_nor_exception():
    future = Future()
    assert (future.done(), future.cancelled()) == (False, False)
    assert (future.result(), future.exception()) == (None, None)


def test_a_result_completes_it():
    future = Future()
    future.set_result(3)
    assert (future.done(), future.result(), future.exception()) == (True, 3, None)


def test_result_raises_the_exception_and_exception_returns_it():
    future = Future()
    error = KeyError("k")
    future.set_exception(error)
    assert future.exception() is error
    with pytest.raises(KeyError, match="k"):
        future.result()


def test_cancelling_runs_the_done_callbacks_and_is_not_being_done():
    future, seen = Future(), []
    future.add_done_callback(seen.append)
    assert future.cancel() is None
    assert seen == [future]
    assert (future.done(), future.cancelled(), future.result()) == (False, True, None)


def test_a_result_after_cancelling_counts():
    future = Future()
    future.cancel()
    future.set_result(4)
    assert (future.done(), future.cancelled(), future.result()) == (True, False, 4)


def test_cancelling_a_completed_future_changes_nothing():
    future = Future()
    future.set_result(4)
    future.cancel()
    assert (future.done(), future.cancelled()) == (True, False)


def test_a_second_result_does_not_hide_an_exception():
    future = Future()
    future.set_exception(KeyError("k"))
    future.set_result(1)
    with pytest.raises(KeyError, match="k"):
        future.result()


def test_done_callbacks_run_in_order_and_one_added_later_at_once():
    future, seen = Future(), []
    future.add_done_callback(lambda _: seen.append(1))
    future.add_done_callback(lambda _: seen.append(2))
    future.set_result(None)
    assert seen == [1, 2]
    future.add_done_callback(lambda _: seen.append(3))
    assert seen == [1, 2, 3]


def test_a_done_callback_that_raises_is_a_warning_and_the_next_one_runs():
    future, seen = Future(), []
    future.add_done_callback(lambda _: 1 / 0)
    future.add_done_callback(seen.append)
    with pytest.warns(UserWarning, match="Unhandled exception in done callback: division by zero"):
        future.set_result(None)
    assert seen == [future]


def test_a_removed_done_callback_does_not_run():
    future, seen = Future(), []
    future.add_done_callback(seen.append)
    assert future.remove_done_callback(seen.append)
    assert not future.remove_done_callback(seen.append)
    future.set_result(None)
    assert seen == []


def test_with_an_executor_done_callbacks_run_when_it_spins(executor):
    future, seen = executor.create_future(), []
    future.add_done_callback(seen.append)
    future.set_result(None)
    assert seen == []
    executor.spin_once(0)
    assert seen == [future]
    future.add_done_callback(seen.append)
    assert len(seen) == 1
    executor.spin_once(0)
    assert len(seen) == 2


def test_awaiting_yields_until_it_is_done():
    future = Future()

    async def wait():
        return await future

    coroutine = wait()
    coroutine.send(None)
    coroutine.send(None)
    future.set_result("here")
    with pytest.raises(StopIteration) as stop:
        coroutine.send(None)
    assert stop.value.value == "here"


def test_awaiting_raises_the_exception():
    future = Future()

    async def wait():
        await future

    coroutine = wait()
    coroutine.send(None)
    future.set_exception(RuntimeError("no"))
    with pytest.raises(RuntimeError, match="no"):
        coroutine.send(None)


@pytest.mark.real_time
async def test_a_coroutine_of_asyncio_awaits_it_while_another_thread_completes_it():
    future = Future()
    threading.Timer(0.01, future.set_result, ["here"]).start()
    assert await asyncio.wait_for(_awaited(future), 60) == "here"


@pytest.mark.real_time
async def test_asyncio_coroutine_that_awaits_it_can_be_cancelled():
    future = Future()
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(_awaited(future), 0.01)
    future.set_result(None)
    await asyncio.sleep(0)


@pytest.mark.real_time
def test_completing_it_after_the_loop_of_its_reader_was_closed_is_silent():
    future = Future()

    async def begin():
        reader = asyncio.ensure_future(_awaited(future))
        await asyncio.sleep(0)
        reader.cancel()

    asyncio.run(begin())
    future.set_result(None)


async def _awaited(future):
    return await future


def test_an_unread_exception_is_printed_when_the_future_is_deleted(capsys):
    future = Future()
    future.set_exception(ValueError("forgotten"))
    del future
    gc.collect()
    assert capsys.readouterr().err == "The following exception was never retrieved: forgotten\n"


def test_repr_of_a_future_names_the_task_module():
    assert repr(Future()).startswith("<taskrpc.ros.packages.rclpy.task.Future object at ")


def test_a_future_does_not_keep_its_executor(context):
    executor = SingleThreadedExecutor(context=context)
    future = Future(executor=executor)
    seen = []
    future.add_done_callback(seen.append)
    del executor
    gc.collect()
    future.set_result(None)
    assert seen == [future]


class Recorder:
    """An executor that only records its tasks."""

    def __init__(self) -> None:
        self.made = []
        self.resumed = []

    def create_task(self, callback, *args):
        self.made.append((callback, args))

    def resume_task(self, task):
        self.resumed.append(task)


def test_a_function_runs_once_with_its_arguments():
    calls = []
    task = Task(lambda *a, **k: calls.append((a, k)) or "result", (1, 2), {"c": 3})
    assert not task.executing()
    task()
    task()
    assert calls == [((1, 2), {"c": 3})]
    assert (task.done(), task.result(), task.executing()) == (True, "result", False)


def test_each_call_continues_the_coroutine():
    steps = []

    async def coroutine(word):
        steps.append("began")
        await asyncio.sleep(0)
        steps.append("went on")
        return word

    task = Task(coroutine, ("end",))
    task()
    assert (steps, task.done()) == (["began"], False)
    task()
    assert (steps, task.result()) == (["began", "went on"], "end")


@pytest.mark.parametrize("kind", ["function", "coroutine"])
def test_an_exception_of_the_function_completes_the_task(kind):
    def function():
        raise ValueError("boom")

    async def coroutine():
        function()

    task = Task(function if kind == "function" else coroutine)
    task()
    assert task.done()
    assert str(task.exception()) == "boom"
    with pytest.raises(ValueError, match="boom"):
        task.result()


def test_system_exit_leaves_the_task():
    task = Task(lambda: exit(3))
    with pytest.raises(SystemExit):
        task()
    assert not task.executing()


def test_done_callbacks_become_tasks_of_the_executor():
    executor = Recorder()
    task = Task(lambda: None, executor=executor)
    task.add_done_callback("a callback")
    task()
    task.add_done_callback("another")
    assert executor.made == [("a callback", (task,)), ("another", (task,))]


def test_task_that_awaits_a_future_is_resumed_only_when_it_is_done():
    executor = Recorder()
    first = Task(lambda: 7, executor=executor)

    async def wait():
        return await first

    second = Task(wait, executor=executor)
    second()
    assert executor.resumed == []
    first()
    assert executor.resumed == [second]
    second()
    assert second.result() == 7


def test_task_that_only_yields_is_resumed_in_the_next_round():
    executor = Recorder()

    async def pause():
        await asyncio.sleep(0)

    task = Task(pause, executor=executor)
    task()
    assert executor.resumed == [task]


def test_cancelling_has_an_effect_only_before_the_task_ran():
    task = Task(lambda: None)
    task.cancel()
    assert task.cancelled()
    task = Task(lambda: None)
    task()
    task.cancel()
    assert not task.cancelled()


def test_task_that_calls_itself_does_not_run_twice():
    calls = []

    def again():
        calls.append(task.executing())
        task()

    task = Task(again)
    task()
    assert calls == [True]


def test_the_state_of_a_future_has_a_name():
    pending, cancelled, finished = Future(), Future(), Future()
    cancelled.cancel()
    finished.set_result(None)
    states = [future._state for future in (pending, cancelled, finished)]
    assert states == [FutureState.PENDING, FutureState.CANCELLED, FutureState.FINISHED]
