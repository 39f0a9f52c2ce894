"""The thread of rclpy's executor, and the hand-off to the event loop."""

from __future__ import annotations

import asyncio
import threading

import pytest

from taskrpc.transport.ros.spinning import Ending, Handoff, Spinner
from tests.taskrpc.transport.ros.fake_ros import Context, Ros


@pytest.mark.real_time
async def test_actions_of_a_thread_run_in_order_on_the_loop():
    seen, done = [], asyncio.Event()
    handoff = Handoff(asyncio.get_running_loop())

    def work():
        for number in range(1000):
            handoff.put(lambda number: seen.append((number, threading.get_ident())), number)
        handoff.put(done.set)

    threading.Thread(target=work).start()
    await done.wait()
    assert seen == [(number, threading.get_ident()) for number in range(1000)]


async def test_many_actions_wake_the_loop_once(monkeypatch):
    loop, woken = asyncio.get_running_loop(), []
    monkeypatch.setattr(
        loop, "call_soon_threadsafe", lambda action: woken.append(loop.call_soon(action))
    )
    seen, handoff = [], Handoff(loop)
    for number in range(5):
        handoff.put(seen.append, number)
    await asyncio.sleep(0)
    assert (len(woken), seen) == (1, [0, 1, 2, 3, 4])


async def test_action_that_raises_does_not_stop_the_others():
    loop, reported, seen = asyncio.get_running_loop(), [], []
    loop.set_exception_handler(lambda _, context: reported.append(context["message"]))
    handoff = Handoff(loop)
    handoff.put(lambda: 1 / 0)
    handoff.put(seen.append, "next")
    await asyncio.sleep(0)
    assert (reported, seen) == (["a callback of ROS 2 failed"], ["next"])


async def test_closed_handoff_drops_actions():
    seen, handoff = [], Handoff(asyncio.get_running_loop())
    handoff.put(seen.append, 1)
    handoff.close()
    handoff.put(seen.append, 2)
    await asyncio.sleep(0)
    assert seen == []


@pytest.mark.real_time
def test_ends_run_one_after_the_other_and_errors_do_not_stop_them():
    ending, seen, over = Ending(), [], threading.Event()
    ending.put(seen.append, 1)
    ending.put(lambda: 1 / 0)
    ending.put(seen.append, 2)
    ending.put(over.set)
    ending.close()
    assert over.wait(10)
    assert seen == [1, 2]
    ending._thread.join(10)
    assert not ending._thread.is_alive()


@pytest.mark.real_time
def test_end_of_python_waits_for_the_last_action():
    ending, seen = Ending(), []
    ending.put(seen.append, "last")
    ending._finish()
    ending.put(seen.append, "after the end")
    assert seen == ["last"]


@pytest.mark.real_time
def test_thread_runs_from_the_first_node_to_the_end(caplog):
    context, errors = Context(), []
    context.init([], initialize_logging=False, domain_id=0)
    spinner = Spinner(Ros(), context, "test")
    spun = threading.Event()

    def spin_once(timeout_sec):
        spun.set()
        if not errors:
            errors.append(1)
            raise ValueError("a damaged message")

    spinner._executor.spin_once = spin_once
    assert not spun.is_set()
    spinner.add("node")
    assert spun.wait(10)
    spinner.close()
    assert not spinner._thread.is_alive()
    assert "a damaged message" in caplog.text
