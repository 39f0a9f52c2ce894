"""Subscriptions call back on the spinning thread; programs can also take or wait for messages."""

import threading

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.exceptions import RCLError, RMWError
from taskrpc.ros.packages.rclpy.qos_event import SubscriptionEventCallbacks
from taskrpc.ros.packages.rclpy.serialization import deserialize_message, serialize_message
from taskrpc.ros.packages.rclpy.subscription import Subscription
from taskrpc.ros.packages.rclpy.subscription_content_filter_options import ContentFilterOptions
from taskrpc.ros.packages.rclpy.wait_for_message import wait_for_message
from tests.ros.packages.rclpy.living import until

pytestmark = pytest.mark.real_time


String = srvgen.load("std_msgs/msg/String")
Int64 = srvgen.load("std_msgs/msg/Int64")


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


def test_slow_subscription_gets_only_the_newest_messages(world, node):
    came = []
    subscription = node.create_subscription(String, "talk", lambda m: came.append(m.data), 2)
    publisher = node.create_publisher(String, "talk", 10)
    for text in "abcd":
        publisher.publish(String(data=text))
    assert publisher.wait_for_all_acked()
    until(lambda: [message.data for message, _ in subscription._messages] == ["c", "d"])
    world.spin_until(lambda: "d" in came)
    assert came == ["c", "d"]


def test_callback_with_two_parameters_gets_the_times_of_the_message(world, node):
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


def test_raw_messages_are_published_and_received_as_cdr(world, node):
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


def test_both_sides_count_publishers_and_subscriptions(node):
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


def filtered(world, subscription, publisher, came):
    """Publish 1 to 3; returns what the callback received."""
    came.clear()
    for number in (1, 2, 3):
        publisher.publish(Int64(data=number))
    assert publisher.wait_for_all_acked()
    world.spin_until(lambda: bool(came) and came[-1] == 3)
    return list(came)


def test_a_content_filter_selects_messages_until_it_is_removed(world, node):
    came = []
    subscription = node.create_subscription(
        Int64,
        "number",
        lambda message: came.append(message.data),
        10,
        content_filter_options=ContentFilterOptions("data > %0", ["1"]),
    )
    publisher = node.create_publisher(Int64, "number", 10)
    assert subscription.is_cft_enabled
    assert filtered(world, subscription, publisher, came) == [2, 3]
    subscription.set_content_filter("data > %0", ["2"])
    assert subscription.get_content_filter() == ContentFilterOptions("data > %0", ["2"])
    assert filtered(world, subscription, publisher, came) == [3]
    subscription.set_content_filter("", [])
    assert not subscription.is_cft_enabled
    assert filtered(world, subscription, publisher, came) == [1, 2, 3]


def test_an_invalid_content_filter_is_refused_and_the_former_one_stays(node):
    subscription = node.create_subscription(Int64, "number", print, 10)
    with pytest.raises(RCLError, match="Failed to get cft expression parameters"):
        subscription.get_content_filter()
    with pytest.raises(RCLError, match="no content filter to remove"):
        subscription.set_content_filter("", [])
    subscription.set_content_filter("data > 1", [])
    with pytest.raises(RCLError, match=r"(?s)Failed to set cft expression.*no field foo"):
        subscription.set_content_filter("foo > 1", [])
    for arguments in ((5, []), ("data > %0", "5"), ("data > %0", [5])):
        with pytest.raises(TypeError, match="expected "):
            subscription.set_content_filter(*arguments)
    assert subscription.get_content_filter() == ContentFilterOptions("data > 1", [])
    with pytest.raises(RCLError, match=r"(?s)Failed to create subscription.*no field foo"):
        node.create_subscription(
            Int64, "number", print, 10, content_filter_options=ContentFilterOptions("foo > 1", [])
        )


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0\xff\0\0\0"])
def test_bytes_that_are_no_message_are_an_error_of_the_middleware(data):
    with pytest.raises(RMWError, match="failed to deserialize ROS message"):
        deserialize_message(data, String)
    with pytest.raises(AttributeError, match="_TYPE_SUPPORT"):
        deserialize_message(data, 5)
