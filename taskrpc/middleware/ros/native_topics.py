"""Topics of ROS 2: publishers and subscriptions of this program, with encoded messages.

rclpy publishes and delivers bytes as well as messages, so srvgen encodes and decodes them.

A type that ROS has not built travels inside a type that it has, on a hidden topic of its own: other
taskrpc programs get it, ROS programs do not.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any

from taskrpc.errors import InvalidRequest
from taskrpc.middleware.ros import bytes_message, qualities
from taskrpc.middleware.ros.conversion import from_ros
from taskrpc.middleware.ros.spinning import Ending, wait_until_sent
from taskrpc.spi import Body, Deliver, Handoff, OnMismatch, TopicEndpoint, cdr, qos_mismatch_text

log = logging.getLogger("taskrpc.transport")

MAX_WARNINGS = 100
"""Warnings of one publisher or subscription; other programs could cause any number."""


class Carrier:
    """How the messages of one class travel: as their own type, or inside one that ROS has."""

    def __init__(self, ros: Any, msg_type: Any, ros_type: Any, bytes_type: Any) -> None:
        self._ros = ros
        self._msg_type = msg_type
        self._ros_type = ros_type
        """ROS's class, None if it has not built the type."""
        self.ros_class = ros_type or bytes_type
        """The class of the topic in ROS."""

    def topic(self, name: str) -> str:
        """The name of the topic in ROS."""
        if self._ros_type is not None:
            return name
        # With the hash, so that programs with different definitions do not meet.
        return f"/_taskrpc/topic_{self._msg_type._HASH[-16:]}{name}"

    def encode(self, message: Any) -> bytes:
        """Return the bytes for rclpy. Raises InvalidRequest."""
        body = cdr.encode(self._msg_type, message)
        return body if self._ros_type is not None else bytes_message.pack(body)

    def decode(self, body: Body) -> Any:
        """Return the message. Raises InvalidRequest."""
        data = bytes(body)
        if self._ros_type is None:
            data = bytes_message.unpack(data) or b""
        try:
            return cdr.decode(self._msg_type, data)
        except InvalidRequest as error:
            return self._decoded_by_ros(data, error)

    def _decoded_by_ros(self, data: bytes, error: InvalidRequest) -> Any:
        """Decode a message with bytes after its end, which some middlewares add."""
        if self._ros_type is None:
            raise error
        try:
            message = self._ros.serialization.deserialize_message(data, self._ros_type)
            found = from_ros(self._msg_type, self._ros_type)(message)
            found._check()
        except Exception:  # rclpy's errors have no common class; the first error is clearer
            raise error from None
        return found


class NativePublisher:
    """A publisher on ROS 2."""

    def __init__(
        self,
        ros: Any,
        node: Any,
        named: TopicEndpoint,
        carrier: Carrier,
        on_mismatch: OnMismatch | None,
        handoff: Handoff,
        ending: Ending,
    ) -> None:
        self.on_matched: Callable[[], object] = _nothing
        self.sent = 0
        self._ros = ros
        self._ending = ending
        self.encode = carrier.encode
        self._node = node
        self._named = named
        mismatch = _Mismatch(named, on_mismatch, handoff, publishes=True)
        self._create = partial(
            node.create_publisher,
            carrier.ros_class,
            carrier.topic(named.name),
            qualities.topic_profile(ros, named),
            event_callbacks=ros.event_handler.PublisherEventCallbacks(
                matched=lambda _: handoff.put(self._report_match),
                incompatible_qos=partial(mismatch.quality, ros),
                incompatible_type=mismatch.type_differs,
                use_default_callbacks=False,
            ),
        )
        self._publisher = self._create()
        self._lost = 0
        self._is_closed = False

    @property
    def matched(self) -> int:
        """How many subscriptions get its messages."""
        return 0 if self._is_closed else int(self._publisher.get_subscription_count())

    @property
    def lost(self) -> int:
        """The number of messages that ROS refused."""
        return self._lost

    def publish(self, body: bytes) -> None:
        """Publish an encoded message."""
        if self._is_closed:
            return
        self.sent += 1
        try:
            self._publisher.publish(body)
        except Exception as error:  # DDS has no room for it
            self._lost += 1
            log.warning("ROS 2 did not publish a message: %s", error)

    def forget_latched(self) -> None:
        """Forget the messages for later subscriptions: ROS needs a new publisher for this."""
        if not self._is_closed:
            self._node.destroy_publisher(self._publisher)
            self._publisher = self._create()

    def close(self) -> None:
        """End the publisher, after its last message has arrived."""
        if not self._is_closed:
            self._is_closed = True
            self._ending.put(self._end)

    def _end(self) -> None:
        if self._named.reliable:
            wait_until_sent(self._ros, self._publisher)
        self._node.destroy_publisher(self._publisher)

    def _report_match(self) -> None:
        if not self._is_closed:
            self.on_matched()


class NativeSubscription:
    """A subscription on ROS 2."""

    def __init__(
        self,
        ros: Any,
        node: Any,
        named: TopicEndpoint,
        carrier: Carrier,
        deliver: Deliver,
        on_mismatch: OnMismatch | None,
        handoff: Handoff,
    ) -> None:
        self.on_matched: Callable[[], object] = _nothing
        self.decode = carrier.decode
        self.lost = 0
        self._deliver: Deliver | None = deliver
        """None once it is closed."""
        self._node = node
        self._reads = 0
        self._is_closed = False
        mismatch = _Mismatch(named, on_mismatch, handoff, publishes=False)
        self._subscription = node.create_subscription(
            carrier.ros_class,
            carrier.topic(named.name),
            lambda body: handoff.put(self._arrived, body),
            qualities.topic_profile(ros, named),
            raw=True,
            event_callbacks=ros.event_handler.SubscriptionEventCallbacks(
                matched=lambda _: handoff.put(self._report_match),
                message_lost=lambda status: handoff.put(self._count_lost, status.total_count),
                incompatible_qos=partial(mismatch.quality, ros),
                incompatible_type=mismatch.type_differs,
                use_default_callbacks=False,
            ),
        )

    @property
    def matched(self) -> int:
        """How many publishers send messages to it."""
        return 0 if self._is_closed else int(self._subscription.get_publisher_count())

    def close(self) -> None:
        """End the subscription."""
        if not self._is_closed:
            self._is_closed = True
            # rclpy keeps the last callback until the next one, and so this object.
            self._deliver, self.on_matched = None, _nothing
            self._node.destroy_subscription(self._subscription)

    def _arrived(self, body: bytes) -> None:
        if self._deliver is not None:
            self._reads += 1
            self._deliver(body, self._reads)

    def _count_lost(self, total: int) -> None:
        self.lost = total

    def _report_match(self) -> None:
        if not self._is_closed:
            self.on_matched()


def _nothing() -> None: ...


class _Mismatch:
    """Reports that the other end of a topic does not match; called on rclpy's thread."""

    def __init__(
        self,
        named: TopicEndpoint,
        on_mismatch: OnMismatch | None,
        handoff: Handoff,
        *,
        publishes: bool,
    ) -> None:
        self._named = named
        self._on_mismatch = on_mismatch
        self._handoff = handoff
        self._publishes = publishes
        self._warnings = 0

    def quality(self, ros: Any, status: Any) -> None:
        """Report that the quality of service does not match."""
        policy = str(ros.qos.qos_policy_name_from_kind(status.last_policy_kind))
        text = qos_mismatch_text(self._named.name, policy, publishes=self._publishes)
        self._handoff.put(self._report, policy, text)

    def type_differs(self, _: Any) -> None:
        """Report that the types differ."""
        named = self._named
        text = f"another program uses {named.name} with another type than {named.type_name}"
        self._handoff.put(self._report, "TYPE", f"{text}: they exchange no messages")

    def _report(self, policy: str, text: str) -> None:
        if self._on_mismatch is not None:
            self._on_mismatch(policy)
        elif self._warnings < MAX_WARNINGS:
            self._warnings += 1
            log.warning("%s", text)
