"""The frames that programs publish on `/tf` and `/tf_static`, for the map of the live page.

The page itself computes where the frames are: it has the robot's pose. All lists are bounded.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from typing import Any

import srvgen
from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.qos import QoS
from taskrpc.spi import RegistryEntry
from taskrpc.topic import Subscription

MAX_FRAMES = 100
"""Most frames of one topic that are kept."""

_QOS = {
    "/tf": QoS(100),
    "/tf_static": QoS(100, "reliable", "transient_local"),
}
_TYPE = "tf2_msgs/msg/TFMessage"
_DIGITS = 4
"""Decimals: tenths of a millimetre, so that noise does not send the frames again."""


class TransformWatch:
    """Subscribes to the topics of transforms while programs publish there."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._subscriptions: dict[str, Subscription[Any]] = {}
        self._frames: dict[str, dict[str, dict[str, Any]]] = {}
        """The newest transform of each frame, by topic and by the frame's name."""

    def watch(self, entries: Iterable[RegistryEntry]) -> None:
        """Follow the publishers: subscribe to new topics, and forget those that have none."""
        published = {
            topic.name
            for entry in entries
            for topic in entry.publishers
            if topic.name in _QOS and topic.type_name == _TYPE
        }
        for gone in self._subscriptions.keys() - published:
            self._subscriptions.pop(gone).destroy()
            self._frames.pop(gone, None)
        for topic in sorted(published - self._subscriptions.keys()):
            with contextlib.suppress(TaskRpcError):  # it tries again at the next look
                self._subscriptions[topic] = self._node.create_subscription(
                    srvgen.load(_TYPE), topic, self._taker(topic), _QOS[topic]
                )

    def close(self) -> None:
        """Stop watching, and forget all frames."""
        self.watch(())

    def frames(self) -> list[dict[str, Any]]:
        """Return the frames with their parents as JSON values, sorted by name."""
        found = self._frames.get("/tf_static", {}) | self._frames.get("/tf", {})
        return [found[name] for name in sorted(found)]

    def _taker(self, topic: str) -> Any:
        def take(message: Any) -> None:
            known = self._frames.setdefault(topic, {})
            for each in message.transforms:
                shown = _frame_json(each)
                if shown is not None and (each.child_frame_id in known or len(known) < MAX_FRAMES):
                    known[each.child_frame_id] = shown

        return take


def _frame_json(transform: Any) -> dict[str, Any] | None:
    """Return a transform as JSON values; None if a number or a name cannot be shown."""
    moved, turned = transform.transform.translation, transform.transform.rotation
    numbers = (moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w)
    length = math.hypot(*numbers[3:])
    name, parent = transform.child_frame_id, transform.header.frame_id
    if not all(map(math.isfinite, numbers)) or length == 0 or not name or not parent:
        return None
    return {
        "name": name,
        "parent": parent,
        "at": [round(number, _DIGITS) for number in numbers[:3]],
        "turn": [round(number / length, _DIGITS) for number in numbers[3:]],
    }
