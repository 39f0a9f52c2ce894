"""Contexts: the time between init and shutdown."""

from __future__ import annotations

import gc
import sys

import pytest

from taskrpc.ros.packages.rclpy.context import Context, end_all_by_signal
from taskrpc.ros.packages.rclpy.exceptions import (
    RCLError,
    RCLInvalidROSArgsError,
    UnknownROSArgsError,
)
from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from tests.ros.packages.rclpy.fakes import FakeNode


def test_a_context_is_ok_from_init_to_shutdown():
    context = Context()
    assert not context.ok()
    assert context.handle is None
    context.init([])
    assert context.ok()
    assert context.handle.ok()
    context.shutdown()
    assert not context.ok()
    assert not context.handle.ok()


def test_with_block_initialises_and_shuts_down():
    with Context() as context:
        assert context.ok()
    assert not context.ok()
    context.try_shutdown()


def test_second_init_or_shutdown_is_refused(context):
    with pytest.raises(RuntimeError, match=r"Context.init\(\) must only be called once"):
        context.init([])
    context.shutdown()
    with pytest.raises(RCLError, match="rcl_shutdown already called"):
        context.shutdown()
    with pytest.raises(RuntimeError, match="must only be called once"):
        context.init([])


def test_an_uninitialised_context_allows_only_try_shutdown():
    context = Context()
    context.try_shutdown()
    with pytest.raises(RuntimeError, match="must be initialized before it can be shutdown"):
        context.shutdown()
    with pytest.raises(RuntimeError, match="must be initialized before it can have a domain id"):
        context.get_domain_id()


@pytest.mark.parametrize(("text", "domain"), [("", 0), ("42", 42), ("many", 0)])
def test_the_domain_comes_from_the_caller_or_the_environment(monkeypatch, text, domain):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    context = Context()
    context.init([])
    assert context.get_domain_id() == domain
    context = Context()
    context.init([], domain_id=123)
    assert (context.get_domain_id(), context.handle.get_domain_id()) == (123, 123)
    with pytest.raises(RuntimeError, match="-1"):
        Context().init([], domain_id=-1)


def test_callbacks_run_at_the_shutdown_and_afterwards_at_once(context):
    seen = []
    context.on_shutdown(lambda: seen.append(1))
    assert seen == []
    context.shutdown()
    context.on_shutdown(lambda: seen.append(2))
    assert seen == [1, 2]
    with pytest.raises(TypeError, match="callable"):
        context.on_shutdown("no function")


def test_shutdown_callback_does_not_keep_its_object_alive(context):
    seen = []

    class Listener:
        def __init__(self, word):
            self.word = word

        def ended(self):
            seen.append(self.word)

    kept, forgotten = Listener("kept"), Listener("forgotten")
    for listener in (kept, forgotten):
        context.on_shutdown(listener.ended)
    del listener, forgotten
    gc.collect()
    context.shutdown()
    assert seen == ["kept"]


def test_the_shutdown_destroys_the_nodes_that_are_tracked(context):
    one, two = FakeNode(context), FakeNode(context)
    context.track_node(one)
    context.track_node(two)
    context.untrack_node(two)
    context.shutdown()
    assert (one.destroyed, two.destroyed) == (True, False)


def test_shutdown_after_a_signal_runs_its_callbacks_once(context):
    seen = []
    context.on_shutdown(lambda: seen.append(1))
    executor = SingleThreadedExecutor(context=context)
    end_all_by_signal()
    assert not context.ok()
    executor.spin()
    assert seen == []
    context.shutdown()
    assert seen == [1]
    with pytest.raises(RCLError):
        context.shutdown()


def test_ros_arguments_are_read_and_unknown_ones_refused():
    context = Context()
    context.init(["program", "--ros-args", "-p", "rate:=3", "--", "rest"])
    assert context.arguments.rest == ["program", "rest"]
    with pytest.raises(UnknownROSArgsError, match=r"\['unknown'\]"):
        Context().init(["--ros-args", "unknown"])
    with pytest.raises(RCLInvalidROSArgsError):
        Context().init(["--ros-args", "-p"])
    with pytest.raises(UnicodeEncodeError):
        Context().init(["Ragnar\udcc3\udcb6k"])


def test_wrong_ros_arguments_are_one_line(monkeypatch, capsys):
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    for arguments, reason in (
        (["-r", "x:="], "RCLInvalidROSArgsError: failed to initialize rcl: Couldn't parse remap"),
        (["--wrong"], "UnknownROSArgsError: Found unknown ROS arguments: ['--wrong']"),
    ):
        with pytest.raises(RuntimeError) as caught:
            Context().init(["--ros-args", *arguments])
        with pytest.raises(SystemExit):
            sys.excepthook(caught.type, caught.value, caught.tb)
        shown = capsys.readouterr().err
        assert reason in shown
        assert shown.count("\n") == 1
