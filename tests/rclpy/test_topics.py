"""Publishers and subscriptions of the layer: callbacks on the spinning thread, depth, raw bytes."""

import threading

import pytest

import srvgen
from taskrpc.rclpy.event_handler import (
    EventHandler,
    IncompatibleTypeInfo,
    QoSEventHandler,
    QoSPublisherEventType,
    QoSPublisherMatchedInfo,
    QoSRequestedIncompatibleQoSInfo,
    QoSSubscriptionEventType,
    QoSSubscriptionMatchedInfo,
)
from taskrpc.rclpy.exceptions import InvalidHandle
from taskrpc.rclpy.qos import QoSPolicyKind, qos_profile_sensor_data
from taskrpc.rclpy.qos_event import PublisherEventCallbacks, SubscriptionEventCallbacks
from taskrpc.rclpy.serialization import deserialize_message, serialize_message
from taskrpc.rclpy.subscription import Subscription
from taskrpc.rclpy.wait_for_message import wait_for_message
from tests.rclpy.living import until

pytestmark = pytest.mark.real_time

Bool = srvgen.load("std_msgs/msg/Bool")
String = srvgen.load("std_msgs/msg/String")


@pytest.fixture
def node(world):
    return world.node()


def test_messages_come_in_order_on_the_spinning_thread(world, node):
    came = []
    node.create_subscription(
        String, "talk", lambda m: came.append((m.data, threading.current_thread())), 10
    )
    publisher = node.create_publisher(String, "talk", 10)
    for text in "abc":
        publisher.publish(String(data=text))
    world.spin_until(lambda: len(came) == 3)
    assert came == [(text, threading.current_thread()) for text in "abc"]


def test_only_the_last_messages_wait_for_a_slow_subscription(world, node):
    came = []
    subscription = node.create_subscription(String, "talk", lambda m: came.append(m.data), 2)
    publisher = node.create_publisher(String, "talk", 10)
    for text in "abcd":
        publisher.publish(String(data=text))
    assert publisher.wait_for_all_acked()
    until(lambda: [message.data for message, _ in subscription._messages] == ["c", "d"])
    world.spin_until(lambda: "d" in came)
    assert came == ["c", "d"]


def test_a_callback_with_two_parameters_learns_when_a_message_came(world, node):
    came = []
    subscription = node.create_subscription(String, "talk", lambda m, info: came.append(info), 10)
    assert subscription._callback_type is Subscription.CallbackType.WithMessageInfo
    node.create_publisher(String, "talk", 10).publish(String())
    world.spin_until(lambda: came)
    assert came[0]["source_timestamp"] > 0


@pytest.mark.parametrize(
    ("callback", "kind"),
    [
        (lambda message: None, Subscription.CallbackType.MessageOnly),
        (lambda message, more=1: None, Subscription.CallbackType.MessageOnly),
        (lambda *all: None, Subscription.CallbackType.MessageOnly),
        (lambda message, info: None, Subscription.CallbackType.WithMessageInfo),
        (print, Subscription.CallbackType.MessageOnly),
    ],
)
def test_a_callback_receives_as_many_arguments_as_it_takes(node, callback, kind):
    with node.create_subscription(String, "talk", callback, 10) as subscription:
        assert subscription._callback_type is kind


@pytest.mark.parametrize("callback", [lambda a, b, c: None, lambda: None, None, 3])
def test_a_callback_with_other_parameters_is_refused(node, callback):
    before = len(list(node.waitables))
    events = SubscriptionEventCallbacks(incompatible_qos=print)
    with pytest.raises(RuntimeError, match="one argument"):
        node.create_subscription(String, "talk", callback, 10, event_callbacks=events)
    assert node.count_subscribers("talk") == 0
    assert len(list(node.waitables)) == before


def test_raw_messages_are_cdr_both_ways(world, node):
    came = []
    node.create_subscription(String, "talk", came.append, 10, raw=True)
    publisher = node.create_publisher(String, "talk", 10)
    publisher.publish(serialize_message(String(data="hello")))
    world.spin_until(lambda: came)
    assert type(came[0]) is bytes
    assert deserialize_message(came[0], String) == String(data="hello")


def test_a_message_of_another_type_is_refused(node):
    publisher = node.create_publisher(String, "talk", 10)
    with pytest.raises(TypeError, match=r"Expected <class .*String'>, got <class 'str'>"):
        publisher.publish("text")


def test_both_sides_know_how_many_there_are(node):
    publisher = node.create_publisher(String, "talk", 10)
    subscription = node.create_subscription(String, "/talk", print, 10)
    assert (publisher.get_subscription_count(), subscription.get_publisher_count()) == (1, 1)
    assert publisher.topic_name == subscription.topic_name == "/talk"
    subscription.destroy()
    assert publisher.get_subscription_count() == 0


def test_a_message_can_be_taken_without_a_callback(node):
    subscription = node.create_subscription(String, "talk", print, 10)
    assert subscription.handle.take_message(String, False) is None
    node.create_publisher(String, "talk", 10).publish(String(data="x"))
    until(subscription.has_work)
    message, info = subscription.handle.take_message(String, False)
    assert (message.data, info["received_timestamp"] > 0) == ("x", True)


def test_one_message_can_be_waited_for_without_spinning(node):
    publisher = node.create_publisher(String, "talk", 10)
    assert wait_for_message(String, node, "talk", time_to_wait=0.05) == (False, None)

    def talk():
        until(publisher.get_subscription_count)
        publisher.publish(String(data="at last"))

    thread = threading.Thread(target=talk)
    thread.start()
    found, message = wait_for_message(String, node, "talk", time_to_wait=5)
    thread.join()
    assert (found, message.data) == (True, "at last")
    assert publisher.get_subscription_count() == 0


def test_callbacks_for_unsupported_events_are_logged(node, capfd):
    node.create_publisher(String, "talk", 10, event_callbacks=PublisherEventCallbacks())
    assert capfd.readouterr().err == ""
    events = SubscriptionEventCallbacks(deadline=print, message_lost=print)
    node.create_subscription(String, "talk", print, 10, event_callbacks=events)
    told = "taskrpc does not report these events of talk: deadline, message_lost"
    assert told in capfd.readouterr().err


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


def test_another_type_is_an_event_too(world, node, capfd):
    told = []
    events = PublisherEventCallbacks(incompatible_type=told.append)
    node.create_publisher(Bool, "talk", 10, event_callbacks=events)
    with node.create_subscription(String, "talk", print, 10):
        world.spin_until(lambda: told)
        until_said(capfd, "topic 'talk', offering incompatible type.")
    assert told == [IncompatibleTypeInfo(total_count=1, total_count_change=1)]


def test_handlers_that_log_are_there_by_default_and_only_then(node):
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


def test_create_event_handlers_gives_the_handlers_of_ros_in_its_order(node):
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
