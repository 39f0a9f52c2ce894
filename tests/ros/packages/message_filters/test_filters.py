"""Filters that bring messages of several topics together."""

import importlib
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SECOND = 10**9


@pytest.fixture
def filters(ros_names):
    return importlib.import_module("message_filters")


@pytest.fixture
def stamped(ros_names):
    load = importlib.import_module
    header, time = load("std_msgs.msg").Header, load("builtin_interfaces.msg").Time
    point = load("geometry_msgs.msg").PointStamped

    def make(seconds):
        whole, part = divmod(round(seconds * SECOND), SECOND)
        return point(header=header(stamp=time(sec=whole, nanosec=part)))

    return make


def joined(kind, filters, *args, **kwargs):
    """A synchronizer, its two inputs, and the sets that it has passed on."""
    inputs = [filters.SimpleFilter(), filters.SimpleFilter()]
    found = []
    kind(inputs, *args, **kwargs).registerCallback(lambda *messages: found.append(messages))
    return *inputs, found


def test_messages_with_equal_times_are_passed_on_together(filters, stamped):
    left, right, found = joined(filters.TimeSynchronizer, filters, 10)
    first, second = stamped(1), stamped(1)
    left.signalMessage(first)
    right.signalMessage(stamped(2))
    assert found == []
    right.signalMessage(second)
    assert found == [(first, second)]
    assert found[0][0] is first
    assert found[0][1] is second


def test_a_full_queue_forgets_its_oldest_message(filters, stamped):
    left, right, found = joined(filters.TimeSynchronizer, filters, 2)
    for seconds in (1, 2, 3):
        left.signalMessage(stamped(seconds))
    for seconds in (1, 2):
        right.signalMessage(stamped(seconds))
    assert [one.header.stamp.sec for one, _ in found] == [2]


def test_nearly_equal_times_are_enough_for_the_approximate_synchronizer(filters, stamped):
    left, right, found = joined(filters.ApproximateTimeSynchronizer, filters, 10, 0.1)
    left.signalMessage(stamped(1.0))
    left.signalMessage(stamped(1.04))
    right.signalMessage(stamped(1.2))
    assert found == []
    right.signalMessage(stamped(1.05))
    assert [one.header.stamp.nanosec for one in found[0]] == [40_000_000, 50_000_000]


def test_a_message_without_header_needs_allow_headerless(filters):
    text = importlib.import_module("std_msgs.msg").String
    left, right, found = joined(filters.ApproximateTimeSynchronizer, filters, 10, 60)
    left.signalMessage(text(data="a"))
    right.signalMessage(text(data="b"))
    assert found == []
    headerless = {"allow_headerless": True}
    left, right, found = joined(filters.ApproximateTimeSynchronizer, filters, 10, 60, **headerless)
    left.signalMessage(text(data="a"))
    right.signalMessage(text(data="b"))
    assert [[one.data for one in each] for each in found] == [["a", "b"]]


def test_a_callback_may_pass_a_message_to_the_synchronizer(filters, stamped):
    inputs = [filters.SimpleFilter(), filters.SimpleFilter()]
    synchronizer = filters.TimeSynchronizer(inputs, 10)
    again = iter([stamped(2)])
    synchronizer.registerCallback(lambda *_: inputs[0].signalMessage(next(again, stamped(3))))
    inputs[0].signalMessage(stamped(1))
    inputs[1].signalMessage(stamped(1))
    assert list(synchronizer.queues[0]) == [2 * SECOND]


def test_cache_finds_messages_by_time(filters, stamped):
    source = filters.SimpleFilter()
    cache = filters.Cache(source, 3)
    from_msg = importlib.import_module("rclpy.time").Time.from_msg

    def time(seconds):
        return from_msg(stamped(seconds).header.stamp)

    passed = []
    cache.registerCallback(passed.append)
    messages = [stamped(seconds) for seconds in (1, 2, 3, 4)]
    for one in messages:
        source.signalMessage(one)
    assert passed == messages
    assert cache.getInterval(time(2), time(3)) == messages[1:3]
    assert cache.getElemAfterTime(time(2.5)) is messages[2]
    assert cache.getElemBeforeTime(time(2.5)) is messages[1]
    assert cache.getElemBeforeTime(time(1)) is None
    assert (cache.getOldestTime(), cache.getLastestTime()) == (time(2), time(4))
    assert cache.getLast() is messages[3]


def test_chain_passes_messages_through_all_filters(filters, stamped):
    source = filters.SimpleFilter()
    chain = filters.Chain(source)
    passed = []
    chain.registerCallback(passed.append)
    source.signalMessage(stamped(1))
    first, second = (filters.Cache(filters.SimpleFilter(), 5) for _ in range(2))
    chain.addFilter(first)
    chain.addFilter(second)
    source.signalMessage(stamped(2))
    assert [one.header.stamp.sec for one in passed] == [1, 2]
    assert len(first.cache_msgs) == len(second.cache_msgs) == 1
    assert chain.getFilter(1) is second
    with pytest.raises(RuntimeError, match="Already connected"):
        chain.connectInput(source)


def test_subscriber_says_which_arguments_it_expects(filters):
    with pytest.raises(TypeError, match=r"Subscriber\(node, type, topic\), got Subscriber\(str, "):
        filters.Subscriber("image", int)


def test_subscriber_passes_on_the_messages_of_its_topic(filters):
    asked = {}

    def create_subscription(msg_type, topic, callback, **settings):
        asked.update(settings, topic=topic, callback=callback)
        return SimpleNamespace(topic_name="/pose")

    node = SimpleNamespace(create_subscription=create_subscription)
    subscriber = filters.Subscriber(node, object, "pose")
    passed = []
    subscriber.registerCallback(lambda *messages: passed.append(messages), "more")
    asked["callback"]("message")
    assert passed == [("message", "more")]
    assert (asked["qos_profile"], asked["topic"], subscriber.getTopic()) == (10, "pose", "pose")
    assert subscriber.topic_name == "/pose"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrivals=st.lists(st.tuples(st.integers(0, 2), st.integers(0, 50)), max_size=60))
def test_sets_of_near_messages_differ_by_less_than_the_slop(filters, arrivals):
    matching = importlib.import_module("message_filters.matching")
    queues = [{}, {}, {}]
    taken = []
    for index, time in arrivals:
        matching.put(queues[index], time, (index, time), 4)
        if time in queues[index]:
            taken += [found] if (found := matching.take_near(queues, time, index, 5)) else []
    for found in taken:
        times = [time for _, time in found]
        assert [index for index, _ in found] == [0, 1, 2]
        assert max(times) - min(times) < 5
    assert all(len(queue) <= 4 for queue in queues)
