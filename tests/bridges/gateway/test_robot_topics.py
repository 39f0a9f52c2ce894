"""The quality of service with which the gateway subscribes and publishes."""

from __future__ import annotations

import itertools

import pytest

from taskrpc.bridges.gateway.robot_topics import topics_of
from taskrpc.core.wire.messages import TopicEndpoint
from taskrpc.core.wire.topics import mismatch_of
from taskrpc.qos import QoS


def endpoint(name="/scan", *, reliable=True, latched=False, depth=1, type_name="a/msg/A"):
    return TopicEndpoint(name, type_name, "", "/node", depth, reliable, latched)


def of_qos(qos):
    return endpoint(reliable=qos.is_reliable, latched=qos.is_latched)


POLICIES = list(itertools.product([False, True], repeat=2))


@pytest.mark.parametrize("one", POLICIES)
@pytest.mark.parametrize("other", POLICIES)
def test_subscription_of_the_gateway_matches_all_publishers(one, other):
    publishers = [endpoint(reliable=each[0], latched=each[1]) for each in (one, other)]
    found = topics_of(publishers)["/scan"]
    assert all(mismatch_of(each, of_qos(found.requested)) is None for each in publishers)
    assert found.requested.is_reliable == (one[0] and other[0])
    assert found.requested.is_latched == (one[1] and other[1])


@pytest.mark.parametrize("policies", [*itertools.product(POLICIES, POLICIES)])
def test_laptop_matches_where_a_ros_program_would_match_some_publisher(policies):
    publishers = [endpoint(reliable=each[0], latched=each[1]) for each in policies]
    offered = of_qos(topics_of(publishers)["/scan"].offered)
    for reliable, latched in POLICIES:
        wanted = endpoint(reliable=reliable, latched=latched)
        if any(mismatch_of(each, wanted) is None for each in publishers):
            assert mismatch_of(offered, wanted) is None


def test_laptop_may_ask_for_reliable_messages_of_a_publisher_with_best_effort():
    assert topics_of([endpoint(reliable=False)])["/scan"].offered == QoS(10)


def test_last_messages_of_all_latched_publishers_are_kept():
    many = [endpoint("/tf_static", latched=True) for _ in range(25)]
    assert topics_of(many)["/tf_static"].offered.depth == 25
    assert topics_of(many)["/tf_static"].requested.depth == 25
    assert topics_of(many * 1000)["/tf_static"].offered.depth == 1000


def test_first_publisher_determines_the_type():
    found = topics_of([endpoint("/x"), endpoint("/x", type_name="b/msg/B"), endpoint("/y")])
    assert {name: each.type_name for name, each in found.items()} == {
        "/x": "a/msg/A",
        "/y": "a/msg/A",
    }
