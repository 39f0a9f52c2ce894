"""Sends transforms of frames that do not move, on `/tf_static`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage


class StaticTransformBroadcaster:
    """Publishes transforms on `/tf_static`, where later subscribers get the last message too.

    As in ROS for Python, one message replaces the message before it: send all transforms of a
    program in one call.

    Args:
        node: the node that publishes.
        qos: a QoSProfile, or the depth of the history.
    """

    def __init__(self, node: Any, qos: Any = None) -> None:
        if qos is None:
            qos = QoSProfile(
                depth=1,
                durability=DurabilityPolicy.TRANSIENT_LOCAL,
                history=HistoryPolicy.KEEP_LAST,
            )
        self.pub_tf = node.create_publisher(TFMessage, "/tf_static", qos)

    def sendTransform(self, transform: Any) -> None:
        """Send a TransformStamped, or several."""
        transforms = list(transform) if isinstance(transform, Iterable) else [transform]
        self.pub_tf.publish(TFMessage(transforms=transforms))
