"""What a node creates: its entities, their QoS, and how they are destroyed."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.exceptions import (
    InvalidHandle,
)
from taskrpc.ros.packages.rclpy.waitable import Waitable

pytestmark = pytest.mark.real_time


String = srvgen.load("std_msgs/msg/String")
Trigger = srvgen.load("std_srvs/srv/Trigger")


def test_entities_are_listed_until_they_are_destroyed(world):
    node = world.node()
    timer = node.create_timer(10, lambda: None)
    publisher = node.create_publisher(String, "chatter", 10)
    subscription = node.create_subscription(String, "chatter", print, 10)
    guard = node.create_guard_condition(lambda: None)
    client = node.create_client(Trigger, "go")
    service = node.create_service(Trigger, "go", lambda request, response: response)
    for thing, things, destroy in [
        (timer, lambda: node.timers, node.destroy_timer),
        (publisher, lambda: node.publishers, node.destroy_publisher),
        (subscription, lambda: node.subscriptions, node.destroy_subscription),
        (guard, lambda: node.guards, node.destroy_guard_condition),
        (client, lambda: node.clients, node.destroy_client),
        (service, lambda: node.services, node.destroy_service),
    ]:
        assert thing in things()
        with thing.handle:
            assert destroy(thing)
        assert thing not in things()
        assert not destroy(thing)
        with pytest.raises(InvalidHandle), thing.handle:
            pass


def test_a_rate_needs_a_frequency_above_zero(world):
    with pytest.raises(ValueError, match="frequency must be > 0"):
        world.node().create_rate(0)


def test_a_waitable_is_asked_until_it_is_removed(world):
    node = world.node()
    before = list(node.waitables)
    done = []

    class Once(Waitable):
        def is_ready(self, wait_set):
            return not done

        def take_data(self):
            return 7

        async def execute(self, taken_data):
            done.append(taken_data)

    waitable = Once(node.default_callback_group)
    node.add_waitable(waitable)
    world.spin_until(lambda: done)
    node.remove_waitable(waitable)
    assert (done, list(node.waitables)) == ([7], before)


@pytest.mark.parametrize(
    ("qos", "kind", "text"),
    [
        (-1, ValueError, "must be greater than or equal to zero"),
        ("foo", TypeError, "Expected QoSProfile or int"),
    ],
)
def test_a_quality_of_service_is_a_profile_or_a_depth(world, qos, kind, text):
    node = world.node()
    with pytest.raises(kind, match=text):
        node.create_publisher(String, "chatter", qos)
    with pytest.raises(kind, match=text):
        node.create_subscription(String, "chatter", print, qos)


def test_a_value_that_is_no_type_is_refused(world):
    node = world.node()
    with pytest.raises(AttributeError, match="_TYPE_SUPPORT"):
        node.create_publisher(int, "chatter", 10)
    with pytest.raises(RuntimeError, match="expected a message type, got the service Trigger"):
        node.create_subscription(Trigger, "chatter", print, 10)
    with pytest.raises(RuntimeError, match="expected a service type, got the message String"):
        node.create_client(String, "go")
    with pytest.raises(AttributeError, match=r"'String' object .* Expected the class String"):
        node.create_publisher(String(), "chatter", 10)


@pytest.mark.parametrize("make", ["create_client", "create_service"])
def test_services_have_profiles_and_no_depths(world, make):
    settings = {"callback": print} if make == "create_service" else {}
    with pytest.raises(AttributeError, match="'int' object has no attribute 'get_c_qos_profile'"):
        getattr(world.node(), make)(Trigger, "go", qos_profile=10, **settings)


@pytest.mark.parametrize(
    ("kind", "create"),
    [
        (
            "subscriptions",
            lambda node, **wrong: node.create_subscription(String, "t", print, 1, **wrong),
        ),
        ("clients", lambda node, **wrong: node.create_client(Trigger, "go", **wrong)),
        ("services", lambda node, **wrong: node.create_service(Trigger, "go", print, **wrong)),
        ("timers", lambda node, **wrong: node.create_timer(10, print, **wrong)),
        ("guards", lambda node, **wrong: node.create_guard_condition(print, **wrong)),
    ],
)
def test_an_entity_without_a_valid_group_is_not_kept(world, kind, create):
    node = world.node()
    before = list(getattr(node, kind))
    with pytest.raises(AttributeError, match="add_entity"):
        create(node, callback_group="none")
    assert list(getattr(node, kind)) == before
    assert create(node) in getattr(node, kind)  # also a service: its name is free again
