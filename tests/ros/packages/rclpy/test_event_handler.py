"""Events of topics: both nodes log incompatible QoS and types in the words of ROS."""

import time

import pytest

import srvgen
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy.duration import Duration
from taskrpc.ros.packages.rclpy.event_handler import (
    EventHandler,
    IncompatibleTypeInfo,
    QoSEventHandler,
    QoSLivelinessChangedInfo,
    QoSLivelinessLostInfo,
    QoSOfferedDeadlineMissedInfo,
    QoSPublisherEventType,
    QoSPublisherMatchedInfo,
    QoSRequestedDeadlineMissedInfo,
    QoSRequestedIncompatibleQoSInfo,
    QoSSubscriptionEventType,
    QoSSubscriptionMatchedInfo,
)
from taskrpc.ros.packages.rclpy.exceptions import InvalidHandle
from taskrpc.ros.packages.rclpy.qos import (
    LivelinessPolicy,
    QoSPolicyKind,
    QoSProfile,
    qos_profile_sensor_data,
)
from taskrpc.ros.packages.rclpy.qos_event import PublisherEventCallbacks, SubscriptionEventCallbacks
from tests.ros.packages.rclpy.living import until

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")
Int32 = srvgen.load("std_msgs/msg/Int32")


@pytest.fixture
def node(world):
    return world.node()


def logged(capfd, *expected):
    ends_at, said = time.monotonic() + 60, ""
    while not all(text in said for text in expected):
        assert time.monotonic() < ends_at, said
        time.sleep(0.01)
        captured = capfd.readouterr()
        said += captured.out + captured.err


def test_both_nodes_log_a_warning_about_incompatible_qos_and_types(capfd):
    with rclpy.init():
        talker, listener = rclpy.create_node("talker"), rclpy.create_node("listener")
        talker.create_publisher(String, "chatter", qos_profile_sensor_data)
        listener.create_subscription(String, "chatter", print, 10)
        logged(
            capfd,
            "[talker]: New subscription discovered on topic 'chatter', requesting incompatible"
            " QoS. No messages will be sent to it. Last incompatible policy: RELIABILITY\n",
            "[listener]: New publisher discovered on topic 'chatter', offering incompatible"
            " QoS. No messages will be received from it. Last incompatible policy: RELIABILITY\n",
        )
        listener.create_subscription(Int32, "chatter", print, qos_profile_sensor_data)
        logged(
            capfd,
            "[listener]: New publisher discovered on topic 'chatter', offering incompatible"
            " type. No messages will be received from it.\n",
        )
        talker.destroy_node()
        listener.destroy_node()


Bool = srvgen.load("std_msgs/msg/Bool")


def test_callbacks_for_unsupported_events_are_logged(node, capfd):
    node.create_publisher(String, "talk", 10, event_callbacks=PublisherEventCallbacks())
    assert capfd.readouterr().err == ""
    events = SubscriptionEventCallbacks(message_lost=print)
    node.create_subscription(String, "talk", print, 10, event_callbacks=events)
    assert "taskrpc does not report the event message_lost of talk" in capfd.readouterr().err


def milliseconds(count):
    return Duration(nanoseconds=count * 1_000_000)


def test_missed_deadlines_are_events_of_both_sides_from_the_first_message_on(world, node):
    offered, requested = [], []
    qos = QoSProfile(depth=10, deadline=milliseconds(10))
    events = SubscriptionEventCallbacks(deadline=requested.append)
    node.create_subscription(String, "talk", lambda _: None, qos, event_callbacks=events)
    events = PublisherEventCallbacks(deadline=offered.append)
    publisher = node.create_publisher(String, "talk", qos, event_callbacks=events)
    until(publisher.get_subscription_count)
    world.executor.spin_once(0.05)
    assert not offered + requested
    publisher.publish(String())
    world.spin_until(lambda: len(offered) > 1 and len(requested) > 1)
    assert offered[1] == QoSOfferedDeadlineMissedInfo(total_count=2, total_count_change=1)
    assert requested[1] == QoSRequestedDeadlineMissedInfo(total_count=2, total_count_change=1)
    node.destroy_publisher(publisher)
    count = len(requested)
    world.spin_until(lambda: len(requested) > count)  # the subscription still waits


def liveliness(alive, more_alive, not_alive, more_not_alive):
    return QoSLivelinessChangedInfo(
        alive_count=alive,
        alive_count_change=more_alive,
        not_alive_count=not_alive,
        not_alive_count_change=more_not_alive,
    )


def test_a_publisher_that_does_not_assert_its_liveliness_loses_it(world, node):
    lost, changed = [], []
    qos = QoSProfile(
        depth=10,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=milliseconds(20),
    )
    events = PublisherEventCallbacks(liveliness=lost.append)
    publisher = node.create_publisher(String, "talk", qos, event_callbacks=events)
    events = SubscriptionEventCallbacks(liveliness=changed.append)
    node.create_subscription(String, "talk", lambda _: None, qos, event_callbacks=events)
    until(publisher.get_subscription_count)
    publisher.assert_liveliness()
    world.spin_until(lambda: lost and len(changed) == 2)
    assert lost == [QoSLivelinessLostInfo(total_count=1, total_count_change=1)]
    publisher.publish(String())
    world.spin_until(lambda: len(lost) == 2 and len(changed) == 4)
    node.destroy_publisher(publisher)
    world.spin_until(lambda: len(changed) == 5)
    assert changed == [
        liveliness(1, 1, 0, 0),
        liveliness(0, -1, 1, 1),
        liveliness(1, 1, 0, -1),
        liveliness(0, -1, 1, 1),
        liveliness(0, 0, 0, -1),
    ]


def test_a_lease_of_the_middleware_ends_with_the_publisher(world, node):
    changed = []
    qos = QoSProfile(depth=10, liveliness_lease_duration=milliseconds(20))
    events = SubscriptionEventCallbacks(liveliness=changed.append)
    node.create_subscription(String, "talk", lambda _: None, qos, event_callbacks=events)
    publisher = node.create_publisher(String, "talk", qos)
    world.spin_until(lambda: changed)
    node.destroy_publisher(publisher)
    world.spin_until(lambda: len(changed) == 2)
    assert changed == [liveliness(1, 1, 0, 0), liveliness(0, -1, 0, 0)]


def test_without_a_requested_lease_liveliness_is_no_event(world, node):
    told = []
    events = SubscriptionEventCallbacks(
        liveliness=told.append, matched=lambda _: told.append("matched")
    )
    node.create_subscription(String, "talk", lambda _: None, 10, event_callbacks=events)
    node.create_publisher(String, "talk", 10)
    world.spin_until(lambda: told)
    world.executor.spin_once(0.01)
    assert told == ["matched"]


def test_topics_without_deadline_and_lease_are_not_watched(node):
    publisher = node.create_publisher(String, "talk", 10)
    subscription = node.create_subscription(String, "talk", lambda _: None, 10)
    assert publisher._timed is None
    assert subscription._timed is None


def test_a_deadline_that_is_not_offered_is_incompatible_on_both_sides(world, node):
    told = []
    both = {"incompatible_qos": told.append}
    node.create_publisher(String, "talk", 10, event_callbacks=PublisherEventCallbacks(**both))
    qos, events = QoSProfile(depth=1, deadline=milliseconds(9)), SubscriptionEventCallbacks(**both)
    node.create_subscription(String, "talk", print, qos, event_callbacks=events)
    world.spin_until(lambda: len(told) == 2)
    assert {each.last_policy_kind for each in told} == {QoSPolicyKind.DEADLINE}


def test_matches_are_events_of_both_sides(world, node):
    told = []
    events = PublisherEventCallbacks(matched=told.append)
    publisher = node.create_publisher(String, "talk", 10, event_callbacks=events)
    one = node.create_subscription(String, "talk", print, 10)
    world.spin_until(lambda: told)
    events = SubscriptionEventCallbacks(matched=lambda info: told.append(("subscription", info)))
    with node.create_subscription(String, "talk", print, 10, event_callbacks=events):
        world.spin_until(lambda: len(told) == 3)
    node.destroy_subscription(one)
    world.spin_until(lambda: len(told) == 5)
    told.remove(("subscription", QoSSubscriptionMatchedInfo(**counts(1, 1, 1, 1))))
    assert told == [
        QoSPublisherMatchedInfo(**counts(*each))
        for each in ((1, 1, 1, 1), (2, 1, 2, 1), (2, 0, 1, -1), (2, 0, 0, -1))
    ]
    kinds = QoSPublisherEventType
    assert [each.event_type for each in publisher.event_handlers] == [
        kinds.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
        kinds.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
        kinds.RCL_PUBLISHER_MATCHED,
    ]


def counts(total, more, current, change):
    return {
        "total_count": total,
        "total_count_change": more,
        "current_count": current,
        "current_count_change": change,
    }


def until_said(capfd, text):
    said = []
    until(lambda: said.append(capfd.readouterr().err) or text in "".join(said))


def test_incompatible_qos_is_logged_on_both_sides(world, node, capfd):
    told = []
    events = SubscriptionEventCallbacks(incompatible_qos=told.append)
    node.create_publisher(String, "talk", qos_profile_sensor_data)
    node.create_subscription(String, "talk", print, 10, event_callbacks=events)
    world.spin_until(lambda: told)
    assert told == [
        QoSRequestedIncompatibleQoSInfo(
            total_count=1, total_count_change=1, last_policy_kind=QoSPolicyKind.RELIABILITY
        )
    ]
    until_said(
        capfd,
        "New subscription discovered on topic 'talk', requesting incompatible QoS. No messages"
        " will be sent to it. Last incompatible policy: RELIABILITY",
    )


def test_incompatible_type_is_an_event(world, node, capfd):
    told = []
    events = PublisherEventCallbacks(incompatible_type=told.append)
    node.create_publisher(Bool, "talk", 10, event_callbacks=events)
    with node.create_subscription(String, "talk", print, 10):
        world.spin_until(lambda: told)
        until_said(capfd, "topic 'talk', offering incompatible type.")
    assert told == [IncompatibleTypeInfo(total_count=1, total_count_change=1)]


def test_logging_handlers_exist_only_by_default(node):
    publisher = node.create_publisher(String, "talk", 10)
    subscription = node.create_subscription(String, "talk", print, 10)
    kinds = [
        [each.event_type.name for each in one.event_handlers] for one in (publisher, subscription)
    ]
    assert kinds == [
        ["RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS", "RCL_PUBLISHER_INCOMPATIBLE_TYPE"],
        ["RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS", "RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE"],
    ]
    quiet = PublisherEventCallbacks(use_default_callbacks=False)
    assert node.create_publisher(String, "talk", 10, event_callbacks=quiet).event_handlers == []


def test_the_old_name_of_event_handlers_is_deprecated(node):
    kind = QoSPublisherEventType.RCL_PUBLISHER_MATCHED
    options = {"callback_group": node.default_callback_group, "callback": print}
    parent = node.create_publisher(String, "talk", 10).handle
    with pytest.warns(DeprecationWarning, match="use EventHandler instead"):
        handler = QoSEventHandler(**options, event_type=kind, parent_impl=parent)
    assert isinstance(handler, EventHandler)


def test_create_event_handlers_returns_the_handlers_in_the_order_of_ros(node):
    group = node.default_callback_group
    publisher = node.create_publisher(String, "talk", 10)
    subscription = node.create_subscription(String, "talk", print, 10)
    every = {"deadline": print, "liveliness": print, "matched": print}
    handlers = PublisherEventCallbacks(**every).create_event_handlers(
        group, publisher.handle, "talk"
    )
    assert [each.event_type for each in handlers] == [
        QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED,
        QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST,
        QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
        QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
        QoSPublisherEventType.RCL_PUBLISHER_MATCHED,
    ]
    callbacks = SubscriptionEventCallbacks(**every, message_lost=print, use_default_callbacks=False)
    handlers = callbacks.create_event_handlers(group, subscription.handle, "talk")
    assert [each.event_type for each in handlers] == [
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED,
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_LIVELINESS_CHANGED,
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST,
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
    ]
    assert all(group.has_entity(each) for each in handlers)


def test_a_handler_made_later_gets_the_events_of_its_parent(world, node):
    told = []
    publisher = node.create_publisher(String, "talk", 10)
    handler = EventHandler(
        callback_group=node.default_callback_group,
        callback=told.append,
        event_type=QoSPublisherEventType.RCL_PUBLISHER_MATCHED,
        parent_impl=publisher.handle,
    )
    node.add_waitable(handler)
    node.create_subscription(String, "talk", print, 10)
    world.spin_until(lambda: told)
    assert told == [QoSPublisherMatchedInfo(**counts(1, 1, 1, 1))]
    handler.destroy()
    with node.create_subscription(String, "talk", print, 10):
        until(lambda: publisher.get_subscription_count() == 2)
    assert not handler.has_work()


def test_a_handler_of_the_wrong_kind_of_event_is_refused(node):
    publisher = node.create_publisher(String, "talk", 10)
    options = {"callback_group": node.default_callback_group, "callback": print}
    options["parent_impl"] = publisher.handle
    with pytest.raises(
        TypeError, match="expected event_type to be a QoSPublisherEventType, got <Q"
    ):
        EventHandler(**options, event_type=QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST)
    node.destroy_publisher(publisher)
    with pytest.raises(InvalidHandle):
        EventHandler(**options, event_type=QoSPublisherEventType.RCL_PUBLISHER_MATCHED)
    with pytest.raises(InvalidHandle):
        PublisherEventCallbacks().create_event_handlers(
            node.default_callback_group, publisher.handle, "talk"
        )


def test_default_event_callbacks_can_be_turned_off(world, node, capfd):
    told = []
    quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
    events = PublisherEventCallbacks(incompatible_qos=told.append)
    node.create_subscription(String, "talk", print, 10, event_callbacks=quiet)
    node.create_publisher(String, "talk", qos_profile_sensor_data, event_callbacks=events)
    world.spin_until(lambda: told)
    assert capfd.readouterr().err == ""
