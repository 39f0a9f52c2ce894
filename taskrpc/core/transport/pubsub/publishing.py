"""The publishers of a process, and the subscriptions of other processes that they feed.

A message is encoded once. If the other process does not read, at most `depth` messages of a
publisher and a bounded number of bytes wait for it; the oldest are dropped and counted.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import OnMismatch
from taskrpc.core.transport.codec import codec_of
from taskrpc.core.wire import topics as wire
from taskrpc.core.wire.events import SubscribeReceived
from taskrpc.core.wire.frames import HEADER, LARGE
from taskrpc.core.wire.messages import DEFAULT_LIMITS, Publishing, TopicEndpoint
from taskrpc.errors import InvalidRequest, ProtocolError

if TYPE_CHECKING:
    from taskrpc.core.transport.connection.server_side import ServingConnection
    from taskrpc.core.transport.pubsub.subscribing import LocalSubscription

log = logging.getLogger("taskrpc.topics")

MAX_WARNINGS = 100
"""Warnings of one publisher; a peer could cause any number of mismatches."""
MAX_OWED = 32 * 1024 * 1024
"""Bytes of messages that may wait for one connection."""


class PublisherTopics(Protocol):
    """What publishers and remote subscriptions need from the topics of their process."""

    def soon(self, action: Callable[[], object]) -> None:
        """Call a function in a later turn of the event loop."""

    def announce_changed(self) -> None:
        """Announce new publishers to the subscriptions of other processes."""

    def publisher_closed(self, publisher: LocalPublisher) -> None:
        """Remove a publisher."""

    def liveliness_changed(self, publisher: LocalPublisher) -> None:
        """Tell the subscriptions whether a publisher is alive."""

    def subscribed(self, subscription: RemoteSubscription) -> None:
        """Add a subscription of another process."""

    def unsubscribed(self, subscription: RemoteSubscription) -> None:
        """Remove a subscription of another process."""

    def role_changed(self, subscription: RemoteSubscription) -> None:
        """Stop the publishers that the subscriber's new role may not see."""


class LocalPublisher:
    """One publisher of this process."""

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
        """Sent with each message, so that a subscription can distinguish publishers."""
        self.role = role
        """The lowest role of a subscriber's account."""
        self._encode = codec_of(msg_type).encode
        self.feeds: dict[RemoteSubscription, Feed] = {}
        """The matched subscriptions of other processes."""
        self.local: dict[LocalSubscription, None] = {}
        """The matched subscriptions of this process."""
        self.on_matched: Callable[[], object] = _nothing
        """Called in a later turn of the loop when the matched subscriptions have changed."""
        self.is_announced = False
        """Whether it was announced to subscriptions; this must precede its first message."""
        self.sent = 0
        self.lost = 0
        """Messages that were dropped, one for each subscription: it did not read, or its process
        does not accept messages of this size."""
        self.latched: deque[tuple[int, bytes]] | None = None
        """The last messages with their sequence numbers, for later subscriptions; else None."""
        if named.latched:
            self.latched = deque(maxlen=named.depth)
        is_manual = named.timing is not None and named.timing.is_manual
        self.alive: bool | None = None if is_manual else True
        """None as long as its program must declare this and has not done so."""
        self._topics = topics
        self._on_mismatch = on_mismatch
        self._warned: set[TopicEndpoint] = set()
        """Subscriptions whose mismatch was reported."""

    @property
    def matched(self) -> int:
        """The number of matched subscriptions."""
        return len(self.feeds) + len(self.local)

    def encode(self, message: Any) -> bytes:
        """Return the message as bytes for `publish`.

        Raises InvalidRequest for another type, if a value does not fit its field, or if the message
        is larger than any process accepts.
        """
        body, limit = self._encode(message), DEFAULT_LIMITS.body
        if len(body) > limit:
            raise InvalidRequest("", f"a message of {len(body)} bytes; at most {limit} can be sent")
        return body

    def publish(self, body: bytes) -> None:
        """Send an encoded message to all matched subscriptions."""
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

    def set_alive(self, alive: bool) -> None:
        """Tell the subscriptions that it is alive, or that its lease has ended."""
        if alive != self.alive:
            self.alive = alive
            self._topics.liveliness_changed(self)

    def unfeed(self, subscription: RemoteSubscription) -> None:
        """Send nothing more to a subscription, if it was matched."""
        feed = self.feeds.pop(subscription, None)
        if feed is not None:
            feed.drop_waiting()
            self.matches_changed()

    def forget_latched(self) -> None:
        """Forget the messages that are kept for later subscriptions."""
        if self.latched is not None:
            self.latched.clear()

    def matches_changed(self) -> None:
        """Report that the matched subscriptions have changed."""
        self._topics.soon(self._report_matches)

    def _report_matches(self) -> None:
        self.on_matched()  # looked up only now: it may have been set in the turn of the match

    def refuses(self, wanted: TopicEndpoint, subscriber: str) -> bool:
        """Whether a subscription does not match; reports each mismatch once."""
        mismatch = wire.mismatch_of(self.named, wanted)
        if mismatch is not None and wanted not in self._warned and len(self._warned) < MAX_WARNINGS:
            self._warned.add(wanted)
            if self._on_mismatch is None:
                log.warning("%s", _unmatched(self.named, wanted, mismatch, subscriber))
            else:
                self._topics.soon(partial(self._on_mismatch, mismatch))
        return mismatch is not None

    def close(self) -> None:
        """End the publisher."""
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
        """Messages with their sequence numbers. If it is not empty, the feed is among the
        subscriber's `feeds_behind`."""

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
        """Send the oldest waiting message; return whether more wait."""
        sequence, body = self.waiting.popleft()
        self._subscriber.owed -= len(body)
        self._write(sequence, body)
        return bool(self.waiting)

    def drop_waiting(self) -> None:
        """Drop all waiting messages."""
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
        """Send it the list of this process's publishers of its topic."""
        connection = self.subscriber.connection
        publishing = [
            Publishing(each.number, each.named, self.refusal(each), each.alive)
            for each in publishers
        ]
        wire.announce(connection.session, self.number, publishing)
        connection.flush_soon()

    def match(self, publisher: LocalPublisher) -> None:
        """Feed it from a publisher, if its role and its QoS allow that."""
        where = self.subscriber.connection.peer_name
        if self.refusal(publisher) or publisher.refuses(self.wanted, where):
            return
        feed = publisher.feeds[self] = Feed(publisher, self.subscriber, self.number)
        publisher.matches_changed()
        if self.wanted.latched and publisher.latched is not None:
            for sequence, body in list(publisher.latched)[-self.wanted.depth :]:
                feed.send(sequence, body)

    def refusal(self, publisher: LocalPublisher) -> str:
        """Why its caller's role is too low for a publisher; "" if it is not."""
        connection = self.subscriber.connection
        if connection.role >= publisher.role:
            return ""
        return (
            f"{publisher.named.name} needs the role {publisher.role.name.lower()}; the account"
            f" {connection.principal} has {connection.role.name.lower()}"
        )


class RemoteSubscriber:
    """The subscriptions of another process over one connection, and the messages that wait."""

    def __init__(self, topics: PublisherTopics, connection: ServingConnection) -> None:
        self.connection = connection
        self.owed = 0
        """Bytes of messages that wait until it reads."""
        self.feeds_behind: dict[Feed, None] = {}
        """Feeds with waiting messages; the feed whose turn is next comes first."""
        self._topics = topics
        self._subscriptions: dict[int, RemoteSubscription] = {}
        self._unwritten = 0
        """Bytes of messages since the last flush."""
        self._has_written = False
        """Whether a message was sent in this turn of the loop."""

    @property
    def is_behind(self) -> bool:
        """Whether it must read before more messages are sent to it."""
        return self.connection.writing_paused or bool(self.feeds_behind)

    def subscribe(self, event: SubscribeReceived) -> None:
        """Add a subscription."""
        number, connection, most = event.subscription_id, self.connection, wire.MAX_SUBSCRIPTIONS
        exists = number in self._subscriptions
        if exists or len(self._subscriptions) >= most:
            many = f"more than {most} subscriptions on one connection"
            problem = f"the subscription {number} exists already" if exists else many
            owner, text = connection.owner, "closed the connection from %s: %s"
            owner.refusals.warning(owner.loop.time(), text, connection.peer_name, problem)
            connection.refuse(ProtocolError(problem))
            return
        subscription = RemoteSubscription(self, number, event.wanted)
        self._subscriptions[number] = subscription
        self._topics.subscribed(subscription)

    def role_changed(self) -> None:
        """Stop the publishers that its account's new role may not see."""
        for subscription in self._subscriptions.values():
            self._topics.role_changed(subscription)

    def unsubscribe(self, number: int) -> None:
        """Remove a subscription."""
        subscription = self._subscriptions.pop(number, None)
        if subscription is not None:
            self._topics.unsubscribed(subscription)

    def left(self) -> None:
        """Remove all subscriptions: the connection is gone."""
        for number in list(self._subscriptions):
            self.unsubscribe(number)
        self.feeds_behind.clear()

    def write(self, number: int, publisher: int, sequence: int, body: bytes) -> None:
        """Send a message: the first of a turn at once, the others together at its end."""
        connection = self.connection
        wire.publish(connection.session, number, publisher, sequence, body)
        self._unwritten += HEADER.size + len(body)
        if self._unwritten >= LARGE or not (self._has_written or connection.in_turn):
            self._flush()
        if not self._has_written:
            self._has_written = True
            connection.owner.loop.call_soon(self._turn_over)

    def caught_up(self) -> None:
        """Send the waiting messages soon: the write buffer has room again."""
        # Two turns, so that the loop reads the sockets between them. If a flood of messages were
        # sent at once, the connection would pause again before a call or a GOAWAY is read.
        loop = self.connection.owner.loop
        if self.feeds_behind:
            loop.call_soon(loop.call_soon, self._send_waiting)

    def _send_waiting(self) -> None:
        """Send waiting messages, one of each publisher in turn."""
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
    """The default of `on_matched`."""


def _unmatched(publisher: TopicEndpoint, wanted: TopicEndpoint, mismatch: str, where: Any) -> str:
    topic = publisher.name
    if mismatch == "TYPE":
        return (
            f"{wanted.node} ({where}) subscribes to {topic} as {wanted.type_name} with the hash"
            f" {wanted.type_hash[:15]}…; it is published as {publisher.type_name} with"
            f" {publisher.type_hash[:15]}…: nothing is sent to it"
        )
    return wire.qos_mismatch_text(topic, mismatch, publishes=True)
