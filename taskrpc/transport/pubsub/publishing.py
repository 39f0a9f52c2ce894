"""The publishers of a process, and the subscriptions of others that they feed.

A message is encoded once. A subscription whose process does not read is owed at most the
publisher's `depth` messages, and a bounded number of bytes; the oldest are dropped and counted.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc.errors import InvalidRequest, ProtocolError
from taskrpc.security.roles import Role
from taskrpc.transport.base import OnMismatch
from taskrpc.transport.codec import codec_of
from taskrpc.wire import topics as wire
from taskrpc.wire.events import SubscribeReceived
from taskrpc.wire.frames import HEADER, LARGE
from taskrpc.wire.messages import DEFAULT_LIMITS, Publishing, TopicEndpoint

if TYPE_CHECKING:
    from taskrpc.transport.connection.server_side import ServingConnection
    from taskrpc.transport.pubsub.subscribing import LocalSubscription

log = logging.getLogger("taskrpc.topics")

MOST_TOLD = 100
"""Warnings of one publisher: peers can make up any number of mismatches."""
MAX_OWED = 32 * 1024 * 1024
"""Bytes of messages that wait for one connection to read."""


class PublisherTopics(Protocol):
    """What publishers and remote subscriptions need from the topics of their process."""

    def soon(self, action: Callable[[], object]) -> None:
        """Do something in a later turn of the event loop."""

    def announce_changed(self) -> None:
        """Announce new publishers to the subscriptions of other processes."""

    def publisher_closed(self, publisher: LocalPublisher) -> None:
        """Remove a publisher."""

    def subscribed(self, subscription: RemoteSubscription) -> None:
        """Add a subscription of another process."""

    def unsubscribed(self, subscription: RemoteSubscription) -> None:
        """Remove a subscription of another process."""

    def role_changed(self, subscription: RemoteSubscription) -> None:
        """Stop the publishers that the subscriber's new role may not see."""


class LocalPublisher:
    """One publisher, seen from the wire."""

    def __init__(
        self,
        topics: PublisherTopics,
        named: TopicEndpoint,
        msg_type: Any,
        number: int,
        role: Role,
        on_mismatch: OnMismatch | None = None,
    ) -> None:
        self.named = named
        self.number = number
        """What its messages carry, so that a subscription tells publishers apart."""
        self.role = role
        """The least that a subscriber's account must be."""
        self._encode = codec_of(msg_type).encode
        self.feeds: dict[RemoteSubscription, Feed] = {}
        self.local: dict[LocalSubscription, None] = {}
        self.on_matched: Callable[[], object] = _nothing
        """Called in a turn of its own when other subscriptions match."""
        self.is_announced = False
        """Whether subscriptions know of it; they shall before its first message."""
        self.sent = 0
        self.lost = 0
        """Messages that did not reach a subscription, since it did not read or takes no such size;
        counted for each."""
        self.latched: deque[tuple[int, bytes]] | None = None
        """The last messages, for those who come later."""
        if named.latched:
            self.latched = deque(maxlen=named.depth)
        self._topics = topics
        self._on_mismatch = on_mismatch
        self._told: set[TopicEndpoint] = set()

    @property
    def matched(self) -> int:
        """How many subscriptions there are."""
        return len(self.feeds) + len(self.local)

    def encode(self, message: Any) -> bytes:
        """What `publish` takes.

        Raises InvalidRequest for another type, a value out of place, or more than anybody accepts.
        """
        body, limit = self._encode(message), DEFAULT_LIMITS.body
        if len(body) > limit:
            raise InvalidRequest("", f"a message of {len(body)} bytes; at most {limit} can be sent")
        return body

    def publish(self, body: bytes) -> None:
        """Send an encoded message to all subscriptions."""
        if not self.is_announced:
            self._topics.announce_changed()
        self.sent += 1
        sequence = self.sent & wire.SEQUENCE_MASK
        if self.latched is not None:
            self.latched.append((sequence, body))
        for feed in self.feeds.values():
            feed.send(sequence, body)
        for subscription in self.local:
            subscription.arrived_here(body)

    def unfeed(self, subscription: RemoteSubscription) -> None:
        """Send nothing more to a subscription, if it was sent anything."""
        feed = self.feeds.pop(subscription, None)
        if feed is not None:
            feed.drop_waiting()
            self.matches_changed()

    def forget_latched(self) -> None:
        """Keep nothing of what was sent so far for those who come later."""
        if self.latched is not None:
            self.latched.clear()

    def matches_changed(self) -> None:
        """Say that it has other subscriptions than before."""
        self._topics.soon(self._tell_of_matches)

    def _tell_of_matches(self) -> None:
        self.on_matched()  # asked for only now: it may have been set in the turn of the match

    def refuses(self, wanted: TopicEndpoint, subscriber: str) -> bool:
        """Whether a subscription does not match; says so, once for each."""
        mismatch = wire.mismatch_of(self.named, wanted)
        if mismatch is not None and wanted not in self._told and len(self._told) < MOST_TOLD:
            self._told.add(wanted)
            if self._on_mismatch is None:
                log.warning("%s", _unmatched(self.named, wanted, mismatch, subscriber))
            else:
                self._topics.soon(partial(self._on_mismatch, mismatch))
        return mismatch is not None

    def close(self) -> None:
        """Publish no more."""
        self._topics.publisher_closed(self)


class Feed:
    """One publisher's messages on their way to one subscription of another process."""

    __slots__ = ("_publisher", "_subscriber", "_subscription_id", "waiting")

    def __init__(
        self, publisher: LocalPublisher, subscriber: RemoteSubscriber, subscription_id: int
    ) -> None:
        self._publisher = publisher
        self._subscriber = subscriber
        self._subscription_id = subscription_id
        self.waiting: deque[tuple[int, bytes]] = deque()
        """As long as there is something, it is among the subscriber's `feeds_behind`."""

    def send(self, sequence: int, body: bytes) -> None:
        """Send a message, or keep it until the other process reads."""
        subscriber = self._subscriber
        if len(body) > subscriber.connection.session.body_limit:
            self._publisher.lost += 1
        elif subscriber.is_behind:
            self._keep(sequence, body)
        else:
            self._write(sequence, body)

    def send_waiting(self) -> bool:
        """Send the oldest message that waits; returns whether more do."""
        sequence, body = self.waiting.popleft()
        self._subscriber.owed -= len(body)
        self._write(sequence, body)
        return bool(self.waiting)

    def drop_waiting(self) -> None:
        """Nobody wants what waits any more."""
        self._subscriber.owed -= sum(len(body) for _, body in self.waiting)
        self._subscriber.feeds_behind.pop(self, None)
        self.waiting.clear()

    def _write(self, sequence: int, body: bytes) -> None:
        self._subscriber.write(self._subscription_id, self._publisher.number, sequence, body)

    def _keep(self, sequence: int, body: bytes) -> None:
        subscriber, waiting = self._subscriber, self.waiting
        if not waiting:
            subscriber.feeds_behind[self] = None
        depth = self._publisher.named.depth
        room = MAX_OWED - len(body)
        while waiting and (len(waiting) >= depth or subscriber.owed > room):
            subscriber.owed -= len(waiting.popleft()[1])
            self._publisher.lost += 1
        waiting.append((sequence, body))
        subscriber.owed += len(body)


class RemoteSubscription:
    """One subscription of another process."""

    def __init__(self, subscriber: RemoteSubscriber, number: int, wanted: TopicEndpoint) -> None:
        self.subscriber = subscriber
        self.number = number
        self.wanted = wanted

    def announce(self, publishers: list[LocalPublisher]) -> None:
        """Tell it who publishes its topic here, and match it with those that it can have."""
        connection = self.subscriber.connection
        publishing = [
            Publishing(each.number, each.named, self.refusal(each)) for each in publishers
        ]
        wire.announce(connection.session, self.number, publishing)
        connection.flush_soon()

    def match(self, publisher: LocalPublisher) -> None:
        """Feed it from a publisher, if it can have that one."""
        where = self.subscriber.connection.peer_name
        if self.refusal(publisher) or publisher.refuses(self.wanted, where):
            return
        feed = publisher.feeds[self] = Feed(publisher, self.subscriber, self.number)
        publisher.matches_changed()
        if self.wanted.latched and publisher.latched is not None:
            for sequence, body in list(publisher.latched)[-self.wanted.depth :]:
                feed.send(sequence, body)

    def refusal(self, publisher: LocalPublisher) -> str:
        """Why its caller's role is too small for a publisher, "" where it is not."""
        connection = self.subscriber.connection
        if connection.role >= publisher.role:
            return ""
        return (
            f"{publisher.named.name} needs the role {publisher.role.name.lower()}; the account"
            f" {connection.principal} has {connection.role.name.lower()}"
        )


class RemoteSubscriber:
    """Another process's end of a connection: its subscriptions, and what they are owed."""

    def __init__(self, topics: PublisherTopics, connection: ServingConnection) -> None:
        self.connection = connection
        self.owed = 0
        """Bytes that wait for it to read."""
        self.feeds_behind: dict[Feed, None] = {}
        """Those with something that waits, in order."""
        self._topics = topics
        self._subscriptions: dict[int, RemoteSubscription] = {}
        self._unwritten = 0
        self._has_written = False

    @property
    def is_behind(self) -> bool:
        """Whether it must read before it gets more."""
        return self.connection.writing_paused or bool(self.feeds_behind)

    def subscribe(self, event: SubscribeReceived) -> None:
        """It wants a topic's messages."""
        number, connection, most = event.subscription_id, self.connection, wire.MAX_SUBSCRIPTIONS
        if number in self._subscriptions or len(self._subscriptions) >= most:
            problem = f"subscription {number} is there already, or one of {most}"
            owner, text = connection.owner, "closed the connection from %s: %s"
            owner.refusals.warning(owner.loop.time(), text, connection.peer_name, problem)
            connection.refuse(ProtocolError(problem))
            return
        subscription = RemoteSubscription(self, number, event.wanted)
        self._subscriptions[number] = subscription
        self._topics.subscribed(subscription)

    def role_changed(self) -> None:
        """Its account may see less than before; what that is, it gets no more."""
        for subscription in self._subscriptions.values():
            self._topics.role_changed(subscription)

    def unsubscribe(self, number: int) -> None:
        """It wants no more of them."""
        subscription = self._subscriptions.pop(number, None)
        if subscription is not None:
            self._topics.unsubscribed(subscription)

    def left(self) -> None:
        """The connection is gone."""
        for number in list(self._subscriptions):
            self.unsubscribe(number)
        self.feeds_behind.clear()

    def write(self, number: int, publisher: int, sequence: int, body: bytes) -> None:
        """Send a message: the first of a turn at once, what follows it together."""
        connection = self.connection
        wire.publish(connection.session, number, publisher, sequence, body)
        self._unwritten += HEADER.size + len(body)
        if self._unwritten >= LARGE or not (self._has_written or connection.in_turn):
            self._flush()
        if not self._has_written:
            self._has_written = True
            connection.owner.loop.call_soon(self._turn_over)

    def caught_up(self) -> None:
        """It has read: hear what it has to say, then send what waits."""
        # Two turns, between which the loop looks at the sockets: sent at once, the messages of a
        # flood would pause the reading again, and nobody would hear a call or a farewell.
        loop = self.connection.owner.loop
        if self.feeds_behind:
            loop.call_soon(loop.call_soon, self._send_waiting)

    def _send_waiting(self) -> None:
        """Each publisher's in turn."""
        behind = self.feeds_behind
        while behind and not self.connection.writing_paused:
            feed = next(iter(behind))
            del behind[feed]
            if feed.send_waiting():
                behind[feed] = None
            self._flush()

    def _turn_over(self) -> None:
        self._has_written = False
        if self._unwritten:
            self._flush()

    def _flush(self) -> None:
        self._unwritten = 0
        self.connection.flush()


def _nothing() -> None:
    """Nobody wants to know."""


def _unmatched(publisher: TopicEndpoint, wanted: TopicEndpoint, mismatch: str, where: Any) -> str:
    topic = publisher.name
    if mismatch == "TYPE":
        return (
            f"{wanted.node} ({where}) subscribes to {topic} as {wanted.type_name} with the hash"
            f" {wanted.type_hash[:15]}…; it is published as {publisher.type_name} with"
            f" {publisher.type_hash[:15]}…: nothing is sent to it"
        )
    return (
        f"New subscription discovered on topic '{topic}', requesting incompatible QoS. No messages"
        f" will be sent to it. Last incompatible policy: {mismatch}"
    )
