"""Topics on a connection: subscriptions, lists of publishers, messages; which of them match.

The subscriber is the connection's client. It chooses a number for each subscription. The server
responds with the list of its publishers, and sends the list again after each change.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

from taskrpc.core.wire import messages
from taskrpc.core.wire.base_session import BaseSession
from taskrpc.core.wire.events import (
    MessageReceived,
    PublishersReceived,
    SubscribeReceived,
    UnsubscribeReceived,
)
from taskrpc.core.wire.frames import Body, Frame, FrameType
from taskrpc.core.wire.messages import TopicEndpoint
from taskrpc.errors import ProtocolError
from taskrpc.qos import Timing

# Module constants: looking an enum's member up takes as long as packing a header.
_SUBSCRIBE, _UNSUBSCRIBE = int(FrameType.SUBSCRIBE), int(FrameType.UNSUBSCRIBE)
_PUBLISH = int(FrameType.PUBLISH)
_NO_LIMITS = Timing()

SEQUENCE_MASK = 0xFFFFFFFF
"""The bits of a sequence number that a frame carries."""
PUBLISHER_MASK = 0xFFFF
"""The bits of a publisher's number that a frame carries."""
MAX_SUBSCRIPTIONS = 4096
"""Subscriptions that one connection may have."""

Mismatch: TypeAlias = Literal["TYPE", "RELIABILITY", "LIVELINESS", "DEADLINE", "DURABILITY"]
"""Why a publisher and a subscription of the same topic do not match."""


def mismatch_of(publisher: TopicEndpoint, subscription: TopicEndpoint) -> Mismatch | None:
    """Return why a publisher and a subscription of its topic do not match; None if they match."""
    if publisher.type_hash != subscription.type_hash:
        return "TYPE"
    # If several policies differ, DDS reports the first of this order.
    if subscription.reliable and not publisher.reliable:
        return "RELIABILITY"
    if subscription.timing is not None:
        refusal = (publisher.timing or _NO_LIMITS).refusal_of(subscription.timing)
        if refusal is not None:
            return refusal
    if subscription.latched and not publisher.latched:
        return "DURABILITY"
    return None


def qos_mismatch_text(topic: str, mismatch: str, *, publishes: bool) -> str:
    """Return rclpy's log line of a publisher or a subscription whose QoS does not match."""
    found, does, end = (
        ("subscription", "requesting", "sent to it")
        if publishes
        else ("publisher", "offering", "received from it")
    )
    return (
        f"New {found} discovered on topic '{topic}', {does} incompatible QoS. No messages will be"
        f" {end}. Last incompatible policy: {mismatch}"
    )


def subscribe(session: BaseSession, subscription_id: int, wanted: TopicEndpoint) -> None:
    """Send a subscription."""
    body = messages.encode(wanted)
    session.send(_SUBSCRIBE, 0, 0, subscription_id, 0, body)


def unsubscribe(session: BaseSession, subscription_id: int) -> None:
    """Send the end of a subscription."""
    session.send(_UNSUBSCRIBE, 0, 0, subscription_id, 0, b"")


def announce(
    session: BaseSession, subscription_id: int, publishers: list[messages.Publishing]
) -> None:
    """Send the list of this process's publishers to a subscription."""
    body = messages.encode(messages.Announcement(publishers))
    session.send(_SUBSCRIBE, 0, 0, subscription_id, 0, body)


def publish(
    session: BaseSession, subscription_id: int, publisher: int, sequence: int, body: Body
) -> None:
    """Send a message to a subscription; `publisher` is the number that was announced."""
    session.send(_PUBLISH, 0, publisher, subscription_id, sequence, body)


def received(
    frame: Frame, *, is_client: bool
) -> SubscribeReceived | UnsubscribeReceived | PublishersReceived | MessageReceived:
    """Return the event of a SUBSCRIBE, UNSUBSCRIBE or PUBLISH frame. Raises ProtocolError."""
    type_, _, publisher, subscription_id, sequence, body = frame
    if is_client:
        if type_ == _PUBLISH:
            return MessageReceived(subscription_id, publisher, sequence, body)
        if type_ == _SUBSCRIBE:
            return PublishersReceived(
                subscription_id, messages.decode_announcement(body).publishers
            )
        raise ProtocolError("a server may not unsubscribe")
    if type_ == _SUBSCRIBE:
        return SubscribeReceived(subscription_id, messages.decode_subscription(body))
    if type_ == _UNSUBSCRIBE:
        return UnsubscribeReceived(subscription_id)
    raise ProtocolError("a client may not publish over the connection on which it subscribes")
