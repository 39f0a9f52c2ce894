"""The topics of the robot as the gateway passes them on: one for all publishers of a name. Pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import msgspec

from taskrpc.qos import QoS, qos_for_all
from taskrpc.spi import TopicEndpoint

_LEAST_DEPTH = 10
"""ROS's graph does not show how many messages a publisher keeps; this is ROS's usual depth."""
_MOST_DEPTH = 1000


class RobotTopic(msgspec.Struct, frozen=True):
    """A topic of the robot."""

    name: str
    type_name: str
    type_hash: str
    requested: QoS
    """What the gateway requests from the robot: it matches all publishers, as with ROS's tools."""
    offered: QoS
    """What the gateway offers. It matches each subscription that some publisher would match, and
    reliable ones: nothing gets lost between the gateway and a laptop."""


def topics_of(publishers: Iterable[TopicEndpoint]) -> dict[str, RobotTopic]:
    """Return the topics of all publishers by name; the first publisher determines the type."""
    found: dict[str, list[TopicEndpoint]] = defaultdict(list)
    for each in publishers:
        found[each.name].append(each)
    return {name: _topic_of(each) for name, each in found.items()}


def _topic_of(publishers: Sequence[TopicEndpoint]) -> RobotTopic:
    first = publishers[0]
    latched = [each.depth for each in publishers if each.latched]
    depth = min(max(sum(latched), _LEAST_DEPTH), _MOST_DEPTH)
    return RobotTopic(
        first.name,
        first.type_name,
        first.type_hash,
        requested=qos_for_all(publishers, depth),
        offered=QoS(depth, durability="transient_local" if latched else "volatile"),
    )
