"""The threads of rclpy's executors, and the thread that ends things."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import pytest

from taskrpc.middleware.ros.spinning import Ending, Spinner, wait_until_sent
from tests import ros_domains
from tests.middleware.ros.fake_ros import Context, InvalidHandle, Ros


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
def test_next_test_with_ros_begins_when_few_programs_have_still_to_leave(monkeypatch):
    """Fast DDS would give its programs numbers with which they never find each other."""
    leaving = []
    for _ in range(ros_domains.MOST_LEAVING + 2):
        ending, gone = Ending(), threading.Event()
        ending.put(gone.wait)
        ending.close()
        leaving.append((ending, gone))

    def sleep(_):
        ending, gone = leaving.pop()
        gone.set()
        ending._thread.join(10)

    monkeypatch.setattr(ros_domains, "time", SimpleNamespace(monotonic=time.monotonic, sleep=sleep))
    try:
        ros_domains.wait_for_those_that_leave()
        assert ros_domains.leaving() == ros_domains.MOST_LEAVING
    finally:
        for _, gone in leaving:
            gone.set()


class FakeNode:
    """Notes the thread that destroys it, and whether its executor waited meanwhile."""

    def __init__(self, spinner):
        self.spinner = spinner
        self.destroyed = []

    def destroy_node(self):
        is_spinning = self.spinner._executor.is_spinning
        self.destroyed.append((threading.current_thread(), is_spinning))


@pytest.fixture
def spinner():
    context = Context()
    context.init([], initialize_logging=False, domain_id=0)
    return Spinner(Ros(), context, "test")


@pytest.mark.real_time
def test_thread_runs_from_the_first_node_to_the_end(spinner, caplog):
    errors, spun = [], threading.Event()

    def spin_once(timeout_sec):
        spun.set()
        if not errors:
            errors.append(1)
            raise ValueError("a damaged message")

    spinner._executor.spin_once = spin_once
    assert not spun.is_set()
    spinner.add(FakeNode(spinner))
    assert spun.wait(10)
    assert spinner.close()
    assert not spinner._thread.is_alive()
    assert "a damaged message" in caplog.text


@pytest.mark.real_time
def test_what_is_closed_before_rclpy_waits_for_it_is_no_error(spinner, caplog):
    spun = []

    def spin_once(timeout_sec):
        spun.append(timeout_sec)
        raise InvalidHandle("cannot use Destroyable because destruction was requested")

    spinner._executor.spin_once = spin_once
    spinner.add(FakeNode(spinner))
    while len(spun) < 2:
        assert spinner._thread.is_alive()
        time.sleep(0.001)
    assert spinner.close()
    assert caplog.text == ""


@pytest.mark.real_time
def test_nodes_are_destroyed_in_the_thread_while_rclpy_does_not_wait(spinner):
    removed, left = FakeNode(spinner), FakeNode(spinner)
    spinner.add(removed)
    spinner.add(left)
    spinner.remove(removed)
    assert spinner.close()
    assert removed.destroyed == left.destroyed == [(spinner._thread, False)]


@pytest.mark.real_time
def test_nodes_are_destroyed_after_the_end_of_the_context_too(spinner):
    node = FakeNode(spinner)
    spinner.add(node)
    spinner._context.try_shutdown()
    assert spinner.close()
    assert node.destroyed == [(spinner._thread, False)]


@pytest.mark.real_time
def test_nodes_of_a_thread_that_hangs_are_not_destroyed(spinner, monkeypatch):
    monkeypatch.setattr("taskrpc.middleware.ros.spinning._JOIN_TIMEOUT", 0.05)
    hang, node = threading.Event(), FakeNode(spinner)
    spinner._executor.spin_once = lambda timeout_sec: hang.wait(10)
    spinner.add(node)
    assert not spinner.close()
    assert node.destroyed == []
    hang.set()
    spinner._thread.join(10)
    assert node.destroyed == [(spinner._thread, False)]


@pytest.mark.real_time
def test_end_of_python_closes_a_thread_that_nobody_closed(spinner, monkeypatch):
    at_exit = []
    monkeypatch.setattr("taskrpc.middleware.ros.spinning.atexit.register", at_exit.append)
    monkeypatch.setattr("taskrpc.middleware.ros.spinning.atexit.unregister", at_exit.remove)
    node = FakeNode(spinner)
    spinner.add(node)
    (close,) = at_exit
    assert close()
    assert node.destroyed == [(spinner._thread, False)]
    assert not spinner._thread.is_alive()
    assert at_exit == []


@pytest.mark.real_time
def test_waiting_for_the_last_messages_asks_often_for_a_short_time(monkeypatch):
    # One long question would keep Python's lock.
    monkeypatch.setattr("taskrpc.middleware.ros.spinning._SEND_TIMEOUT", 0.1)
    asked = []
    ros = Ros()
    publisher = SimpleNamespace(wait_for_all_acked=asked.append)
    wait_until_sent(ros, publisher)
    assert len(asked) > 1
    assert set(asked) == {0}
