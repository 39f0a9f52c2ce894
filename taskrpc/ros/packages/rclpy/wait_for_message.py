"""Waiting for one message, without spinning."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from ._impl.node_entities import topic_profile
from .callback_groups import MutuallyExclusiveCallbackGroup
from .qos import QoSProfile
from .subscription import Subscription

if TYPE_CHECKING:
    from .node import Node

_SLICE = 0.1
"""Seconds of one wait: on Windows, Ctrl-C cannot interrupt a wait."""


def wait_for_message(
    msg_type: Any,
    node: Node,
    topic: str,
    time_to_wait: float = -1,
    *,
    qos_profile: QoSProfile | int = 1,
) -> tuple[bool, Any]:
    """The next message of a topic: (True, message); (False, None) after `time_to_wait` seconds.

    A negative number waits until the context is shut down. Raises RCLError after the shutdown.
    """
    node.context.check_valid("failed to initialize wait set")
    name, qos = node.resolve_topic_name(topic), topic_profile(qos_profile)
    group = MutuallyExclusiveCallbackGroup()
    subscription: Subscription[Any] = Subscription(node, msg_type, name, _unused, group, qos)
    arrived = threading.Event()
    subscription.notify_executor = arrived.set  # type: ignore[method-assign]  # no thread spins it
    end = time.monotonic() + time_to_wait
    try:
        while node.context.ok():
            if (taken := subscription.handle.take_message(msg_type, raw=False)) is not None:
                return True, taken[0]
            left = _SLICE if time_to_wait < 0 else min(_SLICE, end - time.monotonic())
            if left <= 0:
                break
            arrived.wait(left)
            arrived.clear()
        return False, None
    finally:
        subscription.destroy()


def _unused(message: Any) -> None:
    """Does nothing: no executor runs it."""
