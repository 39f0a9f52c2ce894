"""Sends transforms of frames that move, on `/tf`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

if TYPE_CHECKING:
    from rclpy.node import Node


class TransformBroadcaster:
    """Publishes transforms on `/tf`; subscribers get only those that are sent from now on.

    Args:
        node: the node that publishes.
        qos: a QoSProfile, or the depth of the history.
    """

    def __init__(self, node: Node, qos: Any = QoSProfile(depth=100)) -> None:  # noqa: B008
        self.pub_tf = node.create_publisher(TFMessage, "/tf", qos)

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """Send a TransformStamped, or several."""
        transforms = list(transform) if isinstance(transform, Iterable) else [transform]
        self.pub_tf.publish(TFMessage(transforms=transforms))
