"""Tasks: functions and coroutines that run when the task is called."""

from __future__ import annotations

import asyncio

import pytest

from taskrpc.rclpy.task import Task


class Recorder:
    """An executor that only notes what it is to run."""

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


def test_a_coroutine_goes_on_with_each_call():
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
def test_what_it_raises_is_its_exception(kind):
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


def test_an_exit_leaves_it():
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


def test_one_that_awaits_another_is_called_again_only_when_that_is_done():
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


def test_one_that_only_yields_is_called_again_in_the_next_round():
    executor = Recorder()

    async def pause():
        await asyncio.sleep(0)

    task = Task(pause, executor=executor)
    task()
    assert executor.resumed == [task]


def test_cancelling_a_task_that_ran_changes_nothing_and_before_it_does():
    task = Task(lambda: None)
    task.cancel()
    assert task.cancelled()
    task = Task(lambda: None)
    task()
    task.cancel()
    assert not task.cancelled()


def test_a_task_inside_of_itself_does_not_run_twice():
    calls = []

    def again():
        calls.append(task.executing())
        task()

    task = Task(again)
    task()
    assert calls == [True]
