"""The subscriptions of a process, and its links to the processes that publish their topics.

A link connects to one process, as long as that process publishes one of the topics. It connects
again when the connection is lost.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc.core.transport.base import Deliver, OnMismatch
from taskrpc.core.transport.chance import chance_of
from taskrpc.core.transport.codec import codec_of
from taskrpc.core.transport.network import Address, Network
from taskrpc.core.wire import topics as wire
from taskrpc.core.wire.events import MessageReceived, PublishersReceived
from taskrpc.core.wire.frames import Body
from taskrpc.core.wire.messages import Publishing, TopicEndpoint
from taskrpc.errors import ConnectionLost, ProtocolError, TaskRpcError
from taskrpc.retry import reconnect_delay

if TYPE_CHECKING:
    from taskrpc.core.transport.connection.client_side import CallingConnection
    from taskrpc.core.transport.connection.dialling import Dialler
    from taskrpc.core.transport.discovery.availability import Availability

MAX_WARNINGS = 100
"""Warnings of one subscription; a peer could cause any number of mismatches."""
STEADY = 1.0
"""Seconds for which a connection must have lasted to be dialled again without a delay."""
_HALF = wire.SEQUENCE_MASK // 2
"""Sequence numbers wrap around; a larger gap means that the message is late."""

log = logging.getLogger("taskrpc.topics")


class TopicsContext(Protocol):
    """What the topics of an endpoint need from it."""

    id: bytes
    """Identifies the endpoint in handshakes."""
    loop: asyncio.AbstractEventLoop
    network: Network
    availability: Availability
    address: str

    @property
    def dialler(self) -> Dialler:
        """The connections to other processes."""


class SubscriptionTopics(Protocol):
    """What a subscription needs from the topics of its process."""

    def soon(self, action: Callable[[], object]) -> None:
        """Call a function in a later turn of the event loop."""

    def subscription_closed(self, subscription: LocalSubscription) -> None:
        """Remove a subscription."""


class LocalSubscription:
    """One subscription of this process."""

    def __init__(
        self,
        topics: SubscriptionTopics,
        named: TopicEndpoint,
        msg_type: Any,
        number: int,
        deliver: Deliver,
        on_mismatch: OnMismatch | None = None,
    ) -> None:
        self.named = named
        self.number = number
        """Identifies it on every link."""
        self.decode: Callable[[Body], Any] = codec_of(msg_type).decode
        self.publishers: dict[tuple[object, int], bool | None] = {}
        """The matched publishers, by link and number, or (publisher, 0) in this process, and
        whether they are alive; None if unknown."""
        self.lost = 0
        """Messages that publishers sent and that did not arrive."""
        self.on_matched: Callable[[], object] = _nothing
        """Called in a later turn of the loop when the matched publishers have changed."""
        self._topics = topics
        self._deliver = deliver
        self._on_mismatch = on_mismatch
        self._sequences: dict[tuple[bytes, int], int] = {}
        """The last sequence number, by peer id and publisher; kept after a lost connection."""
        self._warned: set[object] = set()
        """Publishers whose mismatch was reported."""

    @property
    def matched(self) -> int:
        """The number of matched publishers."""
        return len(self.publishers)

    @property
    def liveliness(self) -> tuple[int, int]:
        """How many of the matched publishers are alive, and how many are not."""
        states = list(self.publishers.values())
        return states.count(True), states.count(False)

    def matches_changed(self) -> None:
        """Report that the matched publishers have changed."""
        self._topics.soon(self._report_matches)

    def _report_matches(self) -> None:
        self.on_matched()  # looked up only now: it may have been set in the turn of the match

    def arrived_here(self, body: bytes) -> None:
        """Deliver a message of a publisher of this process."""
        self._deliver(body, 0)

    def arrived(self, link: SubscriptionLink, event: MessageReceived, read: int) -> None:
        """Deliver a message of another process, and count lost ones; `read` numbers the read."""
        source = (link.peer_id, event.publisher)
        last = self._sequences.get(source)
        if last is not None and (missed := (event.sequence - last - 1) & wire.SEQUENCE_MASK):
            if missed > _HALF:  # already received: a new connection sends the latched ones again
                return
            self.lost += missed
        self._sequences[source] = event.sequence
        self._deliver(event.body, read)

    def announced(self, link: SubscriptionLink, publishers: list[Publishing]) -> None:
        """Replace the publishers of a process by those that it has announced."""
        self.forget(link)
        numbers = {each.number for each in publishers}
        self.forget_counts(lambda peer_id, n: peer_id == link.peer_id and n not in numbers)
        for each in publishers:
            if self._matches(each):
                self.publishers[link, each.number] = each.alive
        self.matches_changed()

    def forget(self, link: SubscriptionLink) -> None:
        """Forget the publishers of a process."""
        for source in [each for each in self.publishers if each[0] is link]:
            del self.publishers[source]
            self.matches_changed()

    def forget_counts(self, of: Callable[[bytes, int], bool]) -> None:
        """Forget the sequence numbers of publishers for which `of(peer_id, number)` is true."""
        for source in [each for each in self._sequences if of(*each)]:
            del self._sequences[source]

    def refuses(self, publisher: TopicEndpoint) -> bool:
        """Whether a publisher does not match; reports each mismatch once."""
        mismatch = wire.mismatch_of(publisher, self.named)
        if mismatch is not None:
            if self._on_mismatch is None:
                self._warn(publisher, _unmatched(publisher, self.named, mismatch))
            elif self._is_new(publisher):
                self._topics.soon(partial(self._on_mismatch, mismatch))
        return mismatch is not None

    def close(self) -> None:
        """End the subscription."""
        self._topics.subscription_closed(self)

    def _matches(self, each: Publishing) -> bool:
        if each.refusal:
            self._warn(each.publisher, each.refusal)
            return False
        return not self.refuses(each.publisher)

    def _warn(self, about: object, warning: str) -> None:
        if self._is_new(about):
            log.warning("%s", warning)

    def _is_new(self, about: object) -> bool:
        """Whether it was not reported yet, and may be."""
        if about in self._warned or len(self._warned) >= MAX_WARNINGS:
            return False
        self._warned.add(about)
        return True


class SubscriptionLink:
    """The connection to another process that publishes topics of this one's subscriptions."""

    def __init__(self, context: TopicsContext, address: Address) -> None:
        self.address = address
        self.peer_id = b""
        """The id of the process at the other end, once connected."""
        self.subscriptions: dict[int, LocalSubscription] = {}
        """The subscriptions, by number, for which the process publishes."""
        self._context = context
        self._connection: CallingConnection | None = None
        self._is_answered = self._has_too_many = False
        self._without_topics = context.id
        """The id of a process to which nothing is subscribed: this one, under another address, or
        one that does not know topics."""
        self._task = context.loop.create_task(self._keep())

    def want(self, subscriptions: Iterable[LocalSubscription]) -> None:
        """Add subscriptions; subscribe now or once connected."""
        for each in subscriptions:
            if each.number in self.subscriptions:
                continue
            if len(self.subscriptions) >= wire.MAX_SUBSCRIPTIONS:
                self._warn_of_too_many(each)
                return
            self.subscriptions[each.number] = each
            self._subscribe(each)

    def forget(self, subscription: LocalSubscription) -> None:
        """Remove a subscription."""
        if self.subscriptions.pop(subscription.number, None) is not None and self._connection:
            self._connection.say(lambda session: wire.unsubscribe(session, subscription.number))

    def publishers_received(self, event: PublishersReceived) -> None:
        """Pass on the announced publishers of a topic."""
        self._is_answered = True
        subscription = self.subscriptions.get(event.subscription_id)
        if subscription is not None:
            subscription.announced(self, event.publishers)

    def published(self, event: MessageReceived, read: int) -> None:
        """Pass on a message; `read` numbers the read that received it."""
        subscription = self.subscriptions.get(event.subscription_id)
        if subscription is not None:
            subscription.arrived(self, event, read)

    @property
    def is_connected(self) -> bool:
        """Whether it has a connection."""
        return self._connection is not None

    def close(self) -> asyncio.Task[None]:
        """Remove all subscriptions, and stop connecting; return the task that ends."""
        self._forget_counts()
        for subscription in list(self.subscriptions.values()):
            self.forget(subscription)
        if self._connection is not None:
            self._connection.link = None
        self._task.cancel()
        return self._task

    async def _keep(self) -> None:
        loop, failures, reported = self._context.loop, 0, ""
        while True:
            try:
                connection = await self._context.dialler.connection(self.address, None)
            except TaskRpcError as error:
                if reported != str(error):
                    reported = str(error)
                    is_away = isinstance(error, ConnectionLost)  # it may start at any time
                    log.log(logging.DEBUG if is_away else logging.WARNING, "%s", error)
            else:
                reported, began = "", loop.time()
                await self._use(connection)
                self._context.availability.notify()  # the process may be gone: search again
                if loop.time() - began >= STEADY:
                    failures = 0
                    continue
            await asyncio.sleep(reconnect_delay(failures, chance_of(loop).random()))
            failures += 1

    async def _use(self, connection: CallingConnection) -> None:
        """Subscribe over a connection, and wait until it ends."""
        if connection.peer_id != self.peer_id:
            self._forget_counts()
        self.peer_id, self._connection = connection.peer_id, connection
        connection.link = self
        self._is_answered = False
        received = connection.received
        try:
            for subscription in self.subscriptions.values():
                self._subscribe(subscription)
            await asyncio.shield(connection.gone)
        finally:
            self._connection = None
            for subscription in self.subscriptions.values():
                subscription.forget(self)
        # Only if it sent something: a silent process may just have lost its network.
        has_sent = connection.received > received and not self._is_answered
        if has_sent and isinstance(connection.why_closed, ProtocolError):
            self._without_topics = self.peer_id  # subscribing again would break calls to it, too
            log.warning(
                "%s has no topics: it closed the connection when this program subscribed (%s)",
                self.address.text,
                connection.why_closed,
            )

    def _forget_counts(self) -> None:
        for subscription in self.subscriptions.values():
            subscription.forget_counts(lambda peer_id, _: peer_id == self.peer_id)

    def _warn_of_too_many(self, first: LocalSubscription) -> None:
        if not self._has_too_many:
            self._has_too_many = True
            log.warning(
                "%s has %d subscriptions of this program, the most it takes; %s is one more",
                self.address.text,
                len(self.subscriptions),
                first.named.name,
            )

    def _subscribe(self, subscription: LocalSubscription) -> None:
        if self._connection is not None and self.peer_id != self._without_topics:
            number, wanted = subscription.number, subscription.named
            self._connection.say(lambda session: wire.subscribe(session, number, wanted))


def _nothing() -> None:
    """The default of `on_matched`."""


def _unmatched(publisher: TopicEndpoint, wanted: TopicEndpoint, mismatch: str) -> str:
    topic = publisher.name
    if mismatch == "TYPE":
        return (
            f"{publisher.node} publishes {topic} as {publisher.type_name} with the hash"
            f" {publisher.type_hash[:15]}…; {wanted.node} subscribes to it as {wanted.type_name}"
            f" with {wanted.type_hash[:15]}…: nothing is received from it"
        )
    return wire.qos_mismatch_text(topic, mismatch, publishes=False)
