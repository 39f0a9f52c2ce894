"""The state of a launch: scopes of configurations, variables and local values."""

import os

import pytest


def test_scope_restores_configurations_and_variables(launch):
    context = launch.LaunchContext(argv=["a:=1"])
    context.launch_configurations["a"] = "1"
    context.environment["LAUNCH_TEST"] = "outside"
    context.push_launch_configurations()
    context.push_environment()
    context.launch_configurations.update(a="2", b="3")
    context.environment["LAUNCH_TEST"] = "inside"
    context.environment["LAUNCH_TEST_2"] = "inside"
    context.pop_environment()
    context.pop_launch_configurations()
    assert context.launch_configurations == {"a": "1"}
    assert os.environ["LAUNCH_TEST"] == "outside"
    assert "LAUNCH_TEST_2" not in os.environ
    assert context.argv == ["a:=1"]


def test_scopes_cannot_end_before_they_begin(launch):
    context = launch.LaunchContext()
    with pytest.raises(RuntimeError, match="none were pushed"):
        context.pop_launch_configurations()
    with pytest.raises(RuntimeError, match="none were pushed"):
        context.pop_environment()


def test_local_values_are_attributes(launch):
    context = launch.LaunchContext()
    context.push_locals()
    context.extend_locals({"event": "x"})
    assert context.locals.event == "x"
    context.pop_locals()
    with pytest.raises(AttributeError, match="does not contain attribute 'event'"):
        _ = context.locals.event


def test_handlers_are_asked_newest_first(launch):
    context = launch.LaunchContext()
    first, second, last = (launch.EventHandler(matcher=bool) for _ in range(3))
    context.register_event_handler(first)
    context.register_event_handler(second)
    context.register_event_handler(last, append=True)
    assert context.handlers == (second, first, last)
    context.unregister_event_handler(first)
    assert context.handlers == (second, last)
