"""Quality of service: taskrpc's values as ROS's profiles, and back."""

from __future__ import annotations

from typing import Any

from taskrpc.spi import TopicEndpoint

MAX_DEPTH = 5000
"""The most messages that are kept. DDS reserves the places, so a larger depth costs memory."""
_NO_HASH = "RIHS01_" + 64 * "0"
LEAST_DEPTH = 1000
"""Requests and messages that wait until the thread of rclpy reads them. ROS's default of 10 loses
some of a burst. The depth of a subscription limits what waits for its callback, later."""


def topic_profile(ros: Any, named: TopicEndpoint) -> Any:
    """Return the profile of a publisher or subscription."""
    qos = ros.qos
    # The depth of latched messages is what later subscriptions get.
    least = 1 if named.latched else LEAST_DEPTH
    return qos.QoSProfile(
        history=qos.HistoryPolicy.KEEP_LAST,
        depth=min(max(named.depth, least), MAX_DEPTH),
        reliability=_reliability(qos, named.reliable),
        durability=_durability(qos, named.latched),
    )


def service_profile(ros: Any) -> Any:
    """Return the profile of a native service of this program; it matches ROS's default."""
    qos = ros.qos
    return qos.QoSProfile(
        history=qos.HistoryPolicy.KEEP_LAST,
        depth=LEAST_DEPTH,
        reliability=_reliability(qos, reliable=True),
        durability=_durability(qos, latched=False),
    )


def lossless_profile(ros: Any) -> Any:
    """Return a profile that loses nothing."""
    qos = ros.qos
    return qos.QoSProfile(
        history=qos.HistoryPolicy.KEEP_ALL,
        reliability=_reliability(qos, reliable=True),
        durability=_durability(qos, latched=False),
    )


def presence_profile(ros: Any, lease: float) -> Any:
    """Return the profile of a program's presence: DDS reports when its publisher is silent.

    DDS keeps the publisher alive by itself, also while the program computes.
    """
    qos = ros.qos
    return qos.QoSProfile(
        history=qos.HistoryPolicy.KEEP_LAST,
        depth=1,
        reliability=_reliability(qos, reliable=True),
        durability=_durability(qos, latched=True),
        liveliness=qos.LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=ros.duration.Duration(seconds=lease),
    )


def topic_endpoint(ros: Any, name: str, node: str, info: Any) -> TopicEndpoint:
    """Return a foreign publisher or subscription as ROS's graph describes it."""
    profile = info.qos_profile
    return TopicEndpoint(
        name=name,
        type_name=info.topic_type,
        type_hash=hash_text(info.topic_type_hash),
        node=node,
        depth=max(profile.depth, 1),  # the graph shows no depth of other programs
        reliable=profile.reliability == ros.qos.ReliabilityPolicy.RELIABLE,
        latched=profile.durability == ros.qos.DurabilityPolicy.TRANSIENT_LOCAL,
    )


def hash_text(type_hash: Any) -> str:
    """Return a hash of ROS's graph as text, "" if the other program did not send it."""
    text = str(type_hash)
    return text if text.startswith("RIHS01_") and text != _NO_HASH else ""


def _reliability(qos: Any, reliable: bool) -> Any:
    return qos.ReliabilityPolicy.RELIABLE if reliable else qos.ReliabilityPolicy.BEST_EFFORT


def _durability(qos: Any, latched: bool) -> Any:
    return qos.DurabilityPolicy.TRANSIENT_LOCAL if latched else qos.DurabilityPolicy.VOLATILE
