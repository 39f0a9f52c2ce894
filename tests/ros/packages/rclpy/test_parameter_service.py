"""Other nodes get and set a node's parameters, and get an event for each change."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.parameter import Parameter
from taskrpc.ros.packages.rclpy.parameter_event_handler import ParameterEventHandler

pytestmark = pytest.mark.real_time

Descriptor = srvgen.load("rcl_interfaces/msg/ParameterDescriptor")
Event = srvgen.load("rcl_interfaces/msg/ParameterEvent")


def test_each_set_parameter_gets_its_own_result(pair):
    assert pair.set(speed=2.5, names=7, none=1) == [
        (True, ""),
        (False, "Wrong parameter type, expected 'Type.STRING_ARRAY' got 'Type.INTEGER'"),
        (False, "Invalid access to undeclared parameter(s): ['none']"),
    ]
    assert pair.target.get_parameter("speed").value == 2.5


def test_all_are_set_or_none(pair):
    both = [Parameter("speed", value=9.0), Parameter("names", value=7).to_parameter_msg()]
    answer = pair.answer(pair.client.set_parameters_atomically(both))
    assert answer.result.reason.startswith("Wrong parameter type")
    assert pair.target.get_parameter("speed").value == 1.5
    assert pair.answer(pair.client.set_parameters_atomically(both[:1])).result.successful


def test_invalid_parameter_message_is_refused_and_changes_nothing(pair):
    bad = Parameter("speed", value=2.0).to_parameter_msg()
    bad.value.type = 77
    answer = pair.answer(pair.client.set_parameters([bad]))
    assert (answer.results[0].successful, answer.results[0].reason) == (
        False,
        "77 is not a valid Parameter.Type",
    )


def test_only_parameters_with_dynamic_types_can_be_deleted(pair):
    pair.target.declare_parameter("free", 1, Descriptor(dynamic_typing=True))
    future = pair.client.delete_parameters(["free", "speed"])
    assert [one.reason for one in pair.answer(future).results] == [
        "",
        "Static parameter cannot be undeclared",
    ]
    assert not pair.target.has_parameter("free")


def test_every_change_is_an_event(pair):
    events = []
    subscription = pair.client.on_parameter_event(events.append)
    publisher = pair.target._parameter_event_publisher
    pair.spin_until(lambda: publisher.get_subscription_count() >= 1)
    pair.set(speed=3.5)
    pair.spin_until(lambda: events)
    assert [one.name for one in events[0].changed_parameters] == ["speed"]
    assert events[0].node == "/ns/target"
    subscription.destroy()


def test_callbacks_are_called_for_their_parameter_the_last_added_first(pair):
    handler = ParameterEventHandler(pair.asking)
    publisher = pair.target._parameter_event_publisher
    pair.spin_until(lambda: publisher.get_subscription_count() >= 1)
    called = []

    def note(who):
        return lambda message: called.append((who, getattr(message, "name", "event")))

    first = handler.add_parameter_callback("speed", "target", note("first"))
    handler.add_parameter_callback("speed", "/ns/target", note("second"))
    handler.add_parameter_callback("names", "target", note("other"))
    handler.add_parameter_callback("speed", "", note("mine"))
    every = handler.add_parameter_event_callback(note("every"))
    pair.set(speed=7.0)
    pair.spin_until(lambda: len(called) >= 3)
    assert called == [("second", "speed"), ("first", "speed"), ("every", "event")]
    handler.remove_parameter_callback(first)
    handler.remove_parameter_event_callback(every)
    for remove, handle in [
        (handler.remove_parameter_callback, first),
        (handler.remove_parameter_event_callback, every),
    ]:
        with pytest.raises(RuntimeError, match="Callback doesn't exist"):
            remove(handle)
    handler.destroy()
    assert handler.parameter_event_subscription not in pair.asking.subscriptions


def test_a_callback_may_add_another():
    callbacks = ParameterEventHandler.Callbacks()
    callbacks.add_parameter_event_callback(
        lambda event: callbacks.add_parameter_event_callback(lambda event: None)
    )
    callbacks.event_callback(Event())
    assert len(callbacks.event_callbacks) == 2
