"""init, ok and shutdown."""

from __future__ import annotations

from contextvars import copy_context

import pytest

from taskrpc.core.current_program import current_program
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy import signals, utilities
from taskrpc.ros.packages.rclpy.exceptions import RCLError
from taskrpc.ros.packages.rclpy.signals import SignalHandlerOptions


@pytest.fixture(autouse=True)
def down():
    yield
    rclpy.try_shutdown()


def test_program_may_init_and_shut_down_repeatedly():
    for _ in range(2):
        rclpy.init(args=[])
        assert rclpy.ok()
        rclpy.shutdown()
        assert not rclpy.ok()


def test_second_init_and_shutdown_before_init_are_refused():
    rclpy.init(args=[])
    with pytest.raises(RuntimeError, match="must only be called once"):
        rclpy.init(args=[])
    rclpy.shutdown()
    with pytest.raises(RuntimeError, match="must be initialized"):
        rclpy.shutdown()
    rclpy.try_shutdown()


def test_init_as_context_manager_returns_the_context_and_shuts_it_down():
    with rclpy.init(args=[], domain_id=12) as init:
        assert init.context is rclpy.get_default_context()
        assert init.context.get_domain_id() == 12
    assert not init.context.ok()
    assert signals.get_current_signal_handlers_options() == SignalHandlerOptions.NO
    rclpy.init(args=[])


def test_second_context_does_not_change_the_default_context():
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    assert context.ok()
    assert not rclpy.ok()
    assert rclpy.ok(context=context)
    assert signals.get_current_signal_handlers_options() == SignalHandlerOptions.NO
    rclpy.shutdown(context=context)
    with pytest.raises(RCLError):
        rclpy.shutdown(context=context)


def test_the_global_executor_ends_with_its_context():
    rclpy.init(args=[])
    executor = rclpy.get_global_executor()
    assert rclpy.get_global_executor() is executor
    rclpy.shutdown()
    rclpy.init(args=[])
    assert rclpy.get_global_executor() is not executor


def test_programs_in_one_interpreter_have_default_contexts_and_executors_of_their_own():
    def program(name):
        current_program.set(name)
        rclpy.init(args=[])
        return rclpy.get_default_context(), rclpy.get_global_executor()

    one, other = copy_context(), copy_context()
    first_context, first_executor = one.run(program, "one")
    assert not rclpy.ok()
    second_context, second_executor = other.run(program, "other")
    assert first_context is not second_context
    assert first_executor is not second_executor
    one.run(rclpy.shutdown)
    assert second_context.ok()
    assert other.run(rclpy.get_global_executor) is second_executor
    other.run(rclpy.shutdown)


def test_ros_arguments_can_be_removed():
    args = ["program", "--ros-args", "-p", "a:=1", "--", "mine"]
    assert utilities.remove_ros_args(args) == ["program", "mine"]
    assert utilities.remove_ros_args(["--ros-args", "unknown", "--", "mine"]) == ["mine"]


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"), [(None, -1), (-2, -1), (0, 0), (1.5, 15 * 10**8)]
)
def test_timeout_is_converted_to_nanoseconds(seconds, nanoseconds):
    assert utilities.timeout_sec_to_nsec(seconds) == nanoseconds


def test_submodules_are_imported_at_their_first_use():
    from taskrpc.ros.packages.rclpy.parameter import Parameter

    home = rclpy.executors.SingleThreadedExecutor.__module__
    assert home == "taskrpc.ros.packages.rclpy.executors"
    assert rclpy.Parameter is Parameter
    with pytest.raises(AttributeError, match="has no attribute 'bag'"):
        rclpy.bag  # noqa: B018


def test_the_middleware_has_a_name():
    name = rclpy.get_rmw_implementation_identifier()
    assert rclpy.get_available_rmw_implementations() == {name}
