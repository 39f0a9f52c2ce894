"""Sends transforms of frames that do not move, on `/tf_static`."""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

if TYPE_CHECKING:
    from rclpy.node import Node


class StaticTransformBroadcaster:
    """Publishes transforms on `/tf_static`, where later subscribers get the last message too.

    Each message repeats the transforms that the broadcaster has sent before, so later subscribers
    get all of them. A new transform replaces the one of the same child frame.

    Args:
        node: the node that publishes.
        qos: a QoSProfile, or the depth of the history.
    """

    def __init__(self, node: Node, qos: Any = None) -> None:
        if qos is None:
            qos = QoSProfile(
                depth=1,
                durability=DurabilityPolicy.TRANSIENT_LOCAL,
                history=HistoryPolicy.KEEP_LAST,
            )
        self.pub_tf = node.create_publisher(TFMessage, "/tf_static", qos)
        self._sent: dict[str, TransformStamped] = {}
        """The last transform of each child frame."""

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """Send a TransformStamped, or several."""
        transforms = transform if isinstance(transform, Iterable) else [transform]
        self._sent |= {each.child_frame_id: deepcopy(each) for each in transforms}
        self.pub_tf.publish(TFMessage(transforms=list(self._sent.values())))
