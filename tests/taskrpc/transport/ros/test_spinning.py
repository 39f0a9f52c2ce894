"""The thread of rclpy's executor, and the hand-off to the event loop."""

from __future__ import annotations

import threading

import pytest

from taskrpc.transport.ros.spinning import Ending, Spinner
from tests.taskrpc.transport.ros.fake_ros import Context, Ros


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
