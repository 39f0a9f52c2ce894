"""Quality of service in ROS's profiles."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from taskrpc.core.wire.messages import TopicEndpoint
from taskrpc.middleware.ros import qualities
from tests.middleware.ros.fake_ros import Policy, Ros


@pytest.mark.parametrize(
    ("reliable", "latched", "policies"),
    [
        (True, False, (Policy.RELIABLE, Policy.VOLATILE)),
        (False, True, (Policy.BEST_EFFORT, Policy.TRANSIENT_LOCAL)),
    ],
)
def test_profile_of_a_topic(reliable, latched, policies):
    named = TopicEndpoint("/t", "std_msgs/msg/String", "", "/n", 7, reliable, latched)
    profile = qualities.topic_profile(Ros(), named)
    assert (profile.reliability, profile.durability) == policies
    assert profile.depth == (7 if latched else qualities.LEAST_DEPTH)


def test_depth_is_bounded():
    named = TopicEndpoint("/t", "std_msgs/msg/String", "", "/n", 2**31, True, False)
    assert qualities.topic_profile(Ros(), named).depth == qualities.MAX_DEPTH


def test_foreign_endpoint_has_the_values_of_the_graph():
    info = SimpleNamespace(
        topic_type="std_msgs/msg/String",
        topic_type_hash="RIHS01_" + "ab" * 32,
        qos_profile=SimpleNamespace(
            depth=0, reliability=Policy.BEST_EFFORT, durability=Policy.TRANSIENT_LOCAL
        ),
    )
    seen = qualities.topic_endpoint(Ros(), "/t", "/n", info)
    assert seen == TopicEndpoint(
        "/t", "std_msgs/msg/String", "RIHS01_" + "ab" * 32, "/n", 1, False, True
    )


@pytest.mark.parametrize("text", ["INVALID", "RIHS01_" + 64 * "0"])
def test_missing_hash_is_empty(text):
    assert qualities.hash_text(text) == ""
