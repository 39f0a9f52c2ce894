"""Receives only the transforms of frames that do not move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .buffer import Buffer
from .transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener

if TYPE_CHECKING:
    from rclpy.node import Node

__all__ = ["DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC", "StaticTransformListener"]


class StaticTransformListener(TransformListener):
    """A TransformListener of `/tf_static` only; its arguments are those of the same names."""

    def __init__(
        self,
        buffer: Buffer,
        node: Node,
        *,
        spin_thread: bool = False,
        static_qos: Any = None,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
    ) -> None:
        super().__init__(
            buffer,
            node,
            spin_thread=spin_thread,
            static_qos=static_qos,
            tf_static_topic=tf_static_topic,
            static_only=True,
        )
