"""Topics on a connection: a subscription, who publishes its topic, each message; who matches whom.

The subscriber's side is the connection's client. It chooses a number for each subscription; the
publishers' process answers, and says again whenever it changes, which publishers there are.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

from taskrpc.errors import ProtocolError
from taskrpc.wire import messages
from taskrpc.wire.base_session import BaseSession
from taskrpc.wire.events import (
    MessageReceived,
    PublishersReceived,
    SubscribeReceived,
    UnsubscribeReceived,
)
from taskrpc.wire.frames import Body, Frame, FrameType
from taskrpc.wire.messages import TopicEndpoint

# Looking a member up in its class costs as much as packing a header.
_SUBSCRIBE, _UNSUBSCRIBE = int(FrameType.SUBSCRIBE), int(FrameType.UNSUBSCRIBE)
_PUBLISH = int(FrameType.PUBLISH)

SEQUENCE_MASK = 0xFFFFFFFF
PUBLISHER_MASK = 0xFFFF
MAX_SUBSCRIPTIONS = 4096
"""Subscriptions that one connection may have."""

Mismatch: TypeAlias = Literal["TYPE", "RELIABILITY", "DURABILITY"]
"""What stands between a publisher and a subscription of the same topic."""


def mismatch_of(publisher: TopicEndpoint, subscription: TopicEndpoint) -> Mismatch | None:
    """Why a subscription gets nothing from a publisher of its topic; None where it does."""
    if publisher.type_hash != subscription.type_hash:
        return "TYPE"
    if subscription.latched and not publisher.latched:
        return "DURABILITY"
    if subscription.reliable and not publisher.reliable:
        return "RELIABILITY"
    return None


def subscribe(session: BaseSession, subscription_id: int, wanted: TopicEndpoint) -> None:
    """Ask for a topic's messages."""
    body = messages.encode(wanted)
    session.send(_SUBSCRIBE, 0, 0, subscription_id, 0, body)


def unsubscribe(session: BaseSession, subscription_id: int) -> None:
    """Want no more messages."""
    session.send(_UNSUBSCRIBE, 0, 0, subscription_id, 0, b"")


def announce(
    session: BaseSession, subscription_id: int, publishers: list[messages.Publishing]
) -> None:
    """Tell a subscription who publishes its topic here."""
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
    """What a SUBSCRIBE, UNSUBSCRIBE or PUBLISH frame says. Raises ProtocolError."""
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
