"""Introspection publishes the four events of a call, with or without the messages."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.qos import qos_profile_system_default
from taskrpc.ros.packages.rclpy.service_introspection import ServiceIntrospectionState
from tests.ros.packages.rclpy.living import living

pytestmark = pytest.mark.real_time

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
Info = srvgen.load("service_msgs/msg/ServiceEventInfo")


def steps(state):
    """Return the introspection events of one call, by event type."""
    with living() as world:
        node, events = world.node(), []

        def add(request, response):
            response.sum = request.a + request.b
            return response

        service = node.create_service(AddTwoInts, "add", add)
        client = node.create_client(AddTwoInts, "add")
        node.create_subscription(AddTwoInts.Event, "add/_service_event", events.append, 10)
        for side in (service, client):
            side.configure_introspection(node.get_clock(), qos_profile_system_default, state)
        assert world.answer(client.call_async(AddTwoInts.Request(a=1, b=2))).sum == 3
        if state is not ServiceIntrospectionState.OFF:
            world.spin_until(lambda: len(events) == 4)
        world.executor.spin_once(0.05)
        return {event.info.event_type: event for event in events}


def test_events_contain_the_messages_that_are_known_at_that_step():
    published = steps(ServiceIntrospectionState.CONTENTS)
    request, response = [AddTwoInts.Request(a=1, b=2)], [AddTwoInts.Response(sum=3)]
    shown = {kind: (list(one.request), list(one.response)) for kind, one in published.items()}
    assert shown == {
        Info.REQUEST_SENT: (request, []),
        Info.REQUEST_RECEIVED: (request, []),
        Info.RESPONSE_SENT: ([], response),
        Info.RESPONSE_RECEIVED: ([], response),
    }
    assert len({tuple(one.info.client_gid) for one in published.values()}) == 1
    assert all(one.info.stamp.sec > 0 for one in published.values())


def test_metadata_events_have_no_contents():
    published = steps(ServiceIntrospectionState.METADATA)
    assert len(published) == 4
    assert not [one for one in published.values() if list(one.request) or list(one.response)]


def test_nothing_is_published_before_configure():
    assert steps(ServiceIntrospectionState.OFF) == {}
