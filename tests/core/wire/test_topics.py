"""Topic frames arrive unchanged; invalid ones end the connection."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.wire import topics
from taskrpc.core.wire.events import Closed, MessageReceived, PublishersReceived, SubscribeReceived
from taskrpc.core.wire.frames import LARGE, FrameType, pack_frame
from taskrpc.core.wire.messages import Publishing, TopicEndpoint
from taskrpc.qos import Timing
from tests.core.wire.helpers import open_pair, receive

names = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=20)
times = st.integers(0, 2**63 - 1)
timings = st.none() | st.builds(Timing, times, times, st.booleans())
endpoints = st.builds(
    TopicEndpoint,
    *(names, names, names, names),
    *(st.integers(1, 2**31), st.booleans(), st.booleans(), timings),
)
u32 = st.integers(0, 2**32 - 1)


def endpoint(type_hash="h", *, reliable=True, latched=False, **timing):
    limits = Timing(**timing) if timing else None
    return TopicEndpoint("/t", "a/msg/T", type_hash, "/n", 10, reliable, latched, limits)


@given(u32, endpoints, st.integers(1, 100))
def test_a_subscription_arrives(number, wanted, piece):
    pair = open_pair()
    topics.subscribe(pair.client, number, wanted)
    topics.unsubscribe(pair.client, number)
    subscribed, unsubscribed = pair.deliver(pair.server, piece=piece)
    assert subscribed == SubscribeReceived(number, wanted)
    assert unsubscribed.subscription_id == number


publishings = st.builds(
    Publishing, st.integers(0, 0xFFFF), endpoints, names, st.sampled_from([True, False, None])
)


@given(u32, st.lists(publishings, max_size=5))
def test_an_announcement_arrives(number, publishers):
    pair = open_pair()
    topics.announce(pair.server, number, publishers)
    assert pair.deliver(pair.client) == [PublishersReceived(number, publishers)]


@given(st.lists(st.tuples(u32, st.integers(0, 0xFFFF), u32, st.binary(max_size=50)), max_size=20))
def test_messages_arrive_in_order(messages):
    pair = open_pair()
    for message in messages:
        topics.publish(pair.server, *message)
    assert pair.deliver(pair.client) == [MessageReceived(*message) for message in messages]


@pytest.mark.parametrize("size", [LARGE - 1, LARGE, 3 * LARGE])
def test_a_large_message_arrives_between_calls(size):
    pair = open_pair()
    call_id = pair.client.request("ticket", 1, b"question", 100)
    pair.deliver(pair.server)
    body = bytes(range(256)) * (size // 256 + 1)
    topics.publish(pair.server, 1, 2, 3, body[:size])
    pair.server.respond(call_id, b"answer")
    message, answered = pair.deliver(pair.client, piece=10_000)
    assert message == MessageReceived(1, 2, 3, body[:size])
    assert answered.body == b"answer"


@pytest.mark.parametrize(
    ("publisher", "subscription", "mismatch"),
    [
        (endpoint(), endpoint(), None),
        (endpoint(), endpoint("other"), "TYPE"),
        (endpoint(reliable=False), endpoint(), "RELIABILITY"),
        (endpoint(), endpoint(reliable=False), None),
        (endpoint(), endpoint(latched=True), "DURABILITY"),
        (endpoint(latched=True), endpoint(), None),
        (endpoint(reliable=False), endpoint(reliable=False), None),
        (endpoint(), endpoint(deadline=5), "DEADLINE"),
        (endpoint(deadline=6), endpoint(deadline=5), "DEADLINE"),
        (endpoint(deadline=5), endpoint(deadline=5), None),
        (endpoint(deadline=5), endpoint(), None),
        (endpoint(), endpoint(is_manual=True), "LIVELINESS"),
        (endpoint(is_manual=True), endpoint(), None),
        (endpoint(), endpoint(lease=5), "LIVELINESS"),
        (endpoint(lease=6), endpoint(lease=5), "LIVELINESS"),
        (endpoint(lease=4), endpoint(lease=5), None),
        (endpoint(lease=4), endpoint(), None),
    ],
)
def test_publishers_and_subscriptions_match_by_type_and_qos(publisher, subscription, mismatch):
    assert topics.mismatch_of(publisher, subscription) == mismatch


def test_of_several_policies_the_one_of_fast_dds_is_reported():
    everything = endpoint(latched=True, deadline=5, is_manual=True)
    assert topics.mismatch_of(endpoint(reliable=False), everything) == "RELIABILITY"
    assert topics.mismatch_of(endpoint(), everything) == "LIVELINESS"
    assert topics.mismatch_of(endpoint(is_manual=True), everything) == "DEADLINE"


@pytest.mark.parametrize(
    ("to_server", "type_", "body", "why"),
    [
        (True, FrameType.PUBLISH, b"", "a client may not publish"),
        (True, FrameType.SUBSCRIBE, b"\x90", "TopicEndpoint is not valid"),
        (True, FrameType.SUBSCRIBE, b"", "TopicEndpoint is not valid"),
        (False, FrameType.UNSUBSCRIBE, b"", "a server may not unsubscribe"),
        (False, FrameType.SUBSCRIBE, b"\xc1", "Announcement is not valid"),
    ],
)
def test_invalid_topic_frames_end_the_connection(to_server, type_, body, why):
    pair = open_pair()
    end = pair.server if to_server else pair.client
    (closed,) = receive(end, pack_frame(type_, 0, 0, 1, 0, body))
    assert isinstance(closed, Closed)
    assert why in str(closed.error)
