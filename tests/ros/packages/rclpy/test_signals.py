"""What Ctrl-C and SIGTERM do to a program between init and shutdown."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

import srvgen
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy import signals
from taskrpc.ros.packages.rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.signals import SignalHandlerOptions


@pytest.fixture(autouse=True)
def down():
    yield
    rclpy.try_shutdown()


def test_signals_are_handled_while_rclpy_is_up():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    rclpy.init(args=[])
    assert signals.get_current_signal_handlers_options() == SignalHandlerOptions.ALL
    assert signal.getsignal(signal.SIGINT) is not before[0]
    rclpy.shutdown()
    assert signals.get_current_signal_handlers_options() == SignalHandlerOptions.NO
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_program_may_keep_its_own_handlers():
    before = signal.getsignal(signal.SIGINT)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    assert signal.getsignal(signal.SIGINT) is before
    rclpy.shutdown()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.SIGTERM)
    assert signal.getsignal(signal.SIGINT) is before


# Signals, in programs of their own

PROGRAM = """
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy.executors import ExternalShutdownException
from tests.ros.packages.rclpy.fakes import FakeNode

rclpy.init(args=[])
node = FakeNode(rclpy.get_default_context())
node.guard(lambda: print("up", flush=True)).trigger()
"""

windows = sys.platform == "win32"
not_on_windows = pytest.mark.skipif(windows, reason="Windows sends no such signal")


def ended_by(number, body):
    """Send the signal to a program; returns its exit status, stdout and stderr."""
    program = PROGRAM + textwrap.dedent(body)
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[4],
    ) as process:
        assert process.stdout.readline() == "up\n"
        time.sleep(0.1)  # from the first callback to the next sleep
        process.send_signal(number)
        out, err = process.communicate(timeout=120)
    return process.returncode, out, err


@pytest.mark.real_time
@not_on_windows
def test_ctrl_c_ends_a_program_that_does_not_catch_it_in_one_line():
    status, out, err = ended_by(signal.SIGINT, "rclpy.spin(node)")
    assert (status, out, err) == (-signal.SIGINT, "", "KeyboardInterrupt\n")


@pytest.mark.real_time
@not_on_windows
def test_a_program_that_catches_ctrl_c_ends_with_0_and_its_shutdown_is_silent():
    body = """
        try:
            rclpy.spin(node)
        except KeyboardInterrupt:
            print("caught", rclpy.ok())
        finally:
            rclpy.shutdown()
    """
    assert ended_by(signal.SIGINT, body) == (0, "caught False\n", "")


@pytest.mark.end_to_end
@pytest.mark.real_time
@not_on_windows
def test_ctrl_c_interrupts_a_program_that_sleeps_between_spins():
    body = """
        import time
        try:
            while rclpy.ok():
                rclpy.spin_once(node, timeout_sec=0.01)
                time.sleep(5)
        except KeyboardInterrupt:
            print("caught")
    """
    assert ended_by(signal.SIGINT, body) == (0, "caught\n", "")


@pytest.mark.real_time
@not_on_windows
def test_sigterm_ends_the_spinning_with_an_exception():
    body = """
        try:
            rclpy.spin(node)
        except ExternalShutdownException:
            print("ended")
        rclpy.try_shutdown()
    """
    assert ended_by(signal.SIGTERM, body) == (0, "ended\n", "")


@pytest.mark.end_to_end
@pytest.mark.real_time
@not_on_windows
def test_ctrl_c_ends_the_spinning_of_another_thread():
    body = """
        import threading, time
        def spin():
            try:
                rclpy.spin(node)
            except ExternalShutdownException:
                print("thread ended")
                ended.set()
        ended = threading.Event()
        try:
            threading.Thread(target=spin).start()
            while True:
                time.sleep(1)
        except KeyboardInterrupt:
            print(ended.wait(60))
    """
    assert ended_by(signal.SIGINT, body) == (0, "thread ended\nTrue\n", "")


# After the shutdown


@pytest.mark.end_to_end
@pytest.mark.real_time
@not_on_windows
@pytest.mark.parametrize("how", ["shutdown", "signal"])
def test_after_the_shutdown_everything_refuses_as_in_ros(how, tmp_path):
    """The table is that of the real rclpy, with the differences of `test_ros_after_shutdown`."""
    root = Path(__file__).parents[4]
    program = root / "tests" / "interop" / "ros_after_shutdown_program.py"
    ended = subprocess.run(
        [sys.executable, "-m", "taskrpc", "run", str(program), how],
        env=os.environ | {"XDG_RUNTIME_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ended.returncode == 0, ended.stderr
    expected = root / "tests" / "golden" / "after_shutdown" / f"{how}.txt"
    assert ended.stdout.splitlines() == expected.read_text().splitlines()


@pytest.mark.end_to_end
@pytest.mark.real_time
@not_on_windows
@pytest.mark.parametrize(
    "wait",
    [
        "client.wait_for_service(timeout_sec=0.05)",
        "actions.wait_for_server(timeout_sec=0.05)",
        "pool.spin_once()",
    ],
)
def test_sigterm_ends_a_loop_around_a_wait_in_one_line(wait):
    body = f"""
        import srvgen
        from taskrpc.ros.packages.rclpy import action, executors
        real = rclpy.create_node("real")
        client = real.create_client(srvgen.load("std_srvs/srv/Trigger"), "absent")
        actions = action.ActionClient(
            real, srvgen.load("test_msgs/action/Fibonacci"), "missing"
        )
        pool = executors.MultiThreadedExecutor(2)
        rclpy.spin_once(node)  # prints "up"
        while not {wait}:
            pass
    """
    status, _, err = ended_by(signal.SIGTERM, body)
    assert status == 1
    assert len(err.splitlines()) == 1
    assert err.endswith("(a signal has shut rclpy down)\n")


@pytest.mark.faults
@pytest.mark.real_time
@not_on_windows
@pytest.mark.parametrize("mode", ["", "1"])
def test_sigterm_ends_a_program_whose_call_gets_no_response(mode, monkeypatch):
    monkeypatch.setenv("TASKRPC_LIKE_ROS", mode)
    body = """
        import srvgen
        real = rclpy.create_node("real")
        client = real.create_client(srvgen.load("std_srvs/srv/Trigger"), "absent")
        rclpy.spin_once(node)  # prints "up"
        client.call(srvgen.load("std_srvs/srv/Trigger").Request())
    """
    status, _, err = ended_by(signal.SIGTERM, body)
    assert status == 1
    assert err.endswith("ExternalShutdownException (a signal has shut rclpy down)\n")


def test_a_node_may_publish_while_the_shutdown_destroys_it():
    """A node that stops its robot in `destroy_node` must still be heard."""

    class Robot(rclpy.node.Node):
        def destroy_node(self):
            if self.handle.valid:
                stop.publish(String())
                published.append(True)
            super().destroy_node()

    rclpy.init(args=[])
    published = []
    String = srvgen.load("std_msgs/msg/String")
    stop = Robot("robot").create_publisher(String, "stop", 1)
    rclpy.shutdown()
    assert published == [True]


# The package's own names


@pytest.fixture
def up():
    rclpy.init(args=[])


@contextlib.contextmanager
def within_seconds(seconds):
    begin = time.monotonic()
    yield
    assert time.monotonic() - begin < seconds


def signalled_elsewhere(number):
    """Send the signal in 0.1 s from another thread, which also receives it."""
    threading.Timer(0.1, signal.raise_signal, (number,)).start()


@pytest.mark.real_time
@not_on_windows
def test_ctrl_c_that_comes_just_before_a_wait_ends_it(up):
    signalled_elsewhere(signal.SIGINT)
    with within_seconds(60), pytest.raises(KeyboardInterrupt):
        time.sleep(120)


@pytest.mark.real_time
@not_on_windows
@pytest.mark.parametrize(
    ("number", "error"),
    [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, ExternalShutdownException)],
)
def test_a_signal_that_comes_just_before_an_executor_waits_ends_the_spinning(up, number, error):
    executor = SingleThreadedExecutor()
    signalled_elsewhere(number)
    with within_seconds(60), pytest.raises(error):
        executor.spin_once(timeout_sec=120)
    assert not rclpy.ok()


@pytest.mark.real_time
def test_ctrl_c_during_a_destructor_is_raised_afterwards(up):
    class Gone:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)
            gone.append(True)

    gone = []
    with pytest.raises(KeyboardInterrupt):
        let_go_and_wait(Gone)
    assert gone == [True]


def let_go_and_wait(kind):
    kind()
    time.sleep(10)


@pytest.mark.real_time
def test_ctrl_c_leaves_no_lock_locked(up):
    """The signal arrives in `Condition.__enter__`, after the lock was acquired."""

    interrupt = functools.partial(signal.raise_signal, signal.SIGINT)
    lock = SimpleNamespace(acquire=None, release=None, __enter__=interrupt, __exit__=Mock())
    with pytest.raises(KeyboardInterrupt):
        lock_and_wait(threading.Condition(lock))
    lock.__exit__.assert_called_once()


def lock_and_wait(condition):
    with condition:
        pass
    time.sleep(10)


@pytest.mark.real_time
@not_on_windows
def test_the_signal_is_handled_once(up):
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    time.sleep(0.3)  # a second signal would raise here


@pytest.mark.real_time
@not_on_windows
def test_handler_installed_by_a_notebook_or_debugger_gets_a_signal_once(up):
    came = []
    before = signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.3)  # else it would come several times
    finally:
        signal.signal(signal.SIGINT, before)
    assert came == [signal.SIGINT]


@pytest.mark.real_time
@not_on_windows
def test_signal_of_a_forked_child_does_not_reach_its_parent(up):
    child = os.fork()
    if child == 0:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            os._exit(7)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    time.sleep(0.3)  # a signal would raise here


@not_on_windows
def test_a_forked_child_ends_by_sigterm_as_a_pool_of_processes_expects(up):
    child = os.fork()
    if child == 0:
        os.kill(os.getpid(), signal.SIGTERM)
        os._exit(7)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM
    assert signals.get_current_signal_handlers_options() == SignalHandlerOptions.ALL
