"""Receives transforms from `/tf` and `/tf_static`."""

from __future__ import annotations

from threading import Thread
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from .buffer import Buffer

DEFAULT_TF_TOPIC = "/tf"
DEFAULT_STATIC_TF_TOPIC = "/tf_static"

_AUTHORITY = "default_authority"
"""The sender of each transform: messages do not name theirs."""


class TransformListener:
    """Puts the transforms of `/tf` and `/tf_static` into a buffer while its node is spun.

    Args:
        buffer: gets the transforms.
        node: the node that subscribes; None creates one.
        spin_thread: spin the node in a thread of the listener. Then lookups may wait in callbacks.
        qos: a QoSProfile for `/tf`, or the depth of the history.
        static_qos: the same for `/tf_static`.
        tf_topic: the topic of frames that move.
        tf_static_topic: the topic of frames that do not move.
        static_only: do not subscribe to `/tf`.
    """

    def __init__(
        self,
        buffer: Buffer,
        node: Node,
        *,
        spin_thread: bool = False,
        qos: Any = None,
        static_qos: Any = None,
        tf_topic: str = DEFAULT_TF_TOPIC,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
        static_only: bool = False,
    ) -> None:
        self.buffer = buffer
        self.node = _own_node(id(self)) if node is None else node
        # A lookup that waits in a callback must not keep these callbacks from running.
        self.group = ReentrantCallbackGroup()
        if not static_only:
            self.tf_sub = self.node.create_subscription(
                TFMessage,
                tf_topic,
                self.callback,
                _profile(DurabilityPolicy.VOLATILE) if qos is None else qos,
                callback_group=self.group,
            )
        self.tf_static_sub = self.node.create_subscription(
            TFMessage,
            tf_static_topic,
            self.static_callback,
            _profile(DurabilityPolicy.TRANSIENT_LOCAL) if static_qos is None else static_qos,
            callback_group=self.group,
        )
        if spin_thread:
            self.executor = SingleThreadedExecutor(context=self.node.context)
            # A daemon: a program that ends without rclpy.shutdown() does not wait for it.
            self.dedicated_listener_thread = Thread(target=self._spin, daemon=True)
            self.dedicated_listener_thread.start()

    def _spin(self) -> None:
        self.executor.add_node(self.node)
        try:
            self.executor.spin()
        except ExternalShutdownException:
            pass
        finally:
            self.executor.remove_node(self.node)

    def unregister(self) -> None:
        """End the subscriptions."""
        if hasattr(self, "tf_sub"):
            self.node.destroy_subscription(self.tf_sub)
        self.node.destroy_subscription(self.tf_static_sub)

    def callback(self, data: Any) -> None:
        """Put the transforms of a message of `/tf` into the buffer."""
        for transform in data.transforms:
            self.buffer.set_transform(transform, _AUTHORITY)

    def static_callback(self, data: Any) -> None:
        """Put the transforms of a message of `/tf_static` into the buffer."""
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, _AUTHORITY)


def _profile(durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(depth=100, durability=durability, history=HistoryPolicy.KEEP_LAST)


def _own_node(number: int) -> Node:
    return Node(
        f"transform_listener_impl_{number:010x}",
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )
