"""The subscriptions of a process: finds the publishers of their topics, and takes what comes.

One link to each process that publishes any of the topics, for as long as it does; dialled again
when it was lost.
"""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc.errors import ConnectionLost, ProtocolError, TaskRpcError
from taskrpc.retry import reconnect_delay
from taskrpc.transport.base import Deliver, OnMismatch
from taskrpc.transport.codec import codec_of
from taskrpc.transport.network import Address, Network
from taskrpc.wire import topics as wire
from taskrpc.wire.events import MessageReceived, PublishersReceived
from taskrpc.wire.frames import Body
from taskrpc.wire.messages import Publishing, TopicEndpoint

if TYPE_CHECKING:
    from taskrpc.transport.connection.client_side import CallingConnection
    from taskrpc.transport.connection.dialling import Dialler
    from taskrpc.transport.discovery.availability import Availability
    from taskrpc.transport.discovery.entries import EntryChange

MOST_TOLD = 100
"""Warnings of one subscription: peers can make up any number of mismatches."""
STEADY = 1.0
"""Seconds after which a connection that is lost is dialled again at once."""
_HALF = wire.SEQUENCE_MASK // 2
"""Counts wrap around: a message that is further ahead is one of before."""

log = logging.getLogger("taskrpc.topics")


class TopicsContext(Protocol):
    """What the topics of an endpoint need of it."""

    id: bytes
    """What its callers know it by, and those whom it calls."""
    loop: asyncio.AbstractEventLoop
    network: Network
    dialler: Dialler
    availability: Availability
    address: str

    def publish(self, change: EntryChange, *, claim: str = "") -> None:
        """Tell everybody of a change to what this process has."""


class SubscriptionTopics(Protocol):
    """What a subscription needs from the topics of its process."""

    def soon(self, action: Callable[[], object]) -> None:
        """Do something in a later turn of the event loop."""

    def subscription_closed(self, subscription: LocalSubscription) -> None:
        """Remove a subscription."""


class LocalSubscription:
    """One subscription, seen from the wire."""

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
        self.decode: Callable[[Body], Any] = codec_of(msg_type).decode
        self.publishers: dict[tuple[object, int], TopicEndpoint] = {}
        """Those that it gets messages from, by link and number."""
        self.lost = 0
        """Messages that publishers sent and that did not come."""
        self.on_matched: Callable[[], object] = _nothing
        """Called in a turn of its own when other publishers match."""
        self._topics = topics
        self._deliver = deliver
        self._on_mismatch = on_mismatch
        self._sequences: dict[tuple[bytes, int], int] = {}
        """What came last, by the publishers' program and number; kept over lost connections."""
        self._told: set[object] = set()

    @property
    def matched(self) -> int:
        """How many publishers there are."""
        return len(self.publishers)

    def matches_changed(self) -> None:
        """Say that it has other publishers than before."""
        self._topics.soon(self._tell_of_matches)

    def _tell_of_matches(self) -> None:
        self.on_matched()  # asked for only now: it may have been set in the turn of the match

    def arrived_here(self, body: bytes) -> None:
        """Deliver a message of a publisher of this process."""
        self._deliver(body, 0)

    def arrived(self, link: SubscriptionLink, event: MessageReceived, read: int) -> None:
        """A message came, with others of the same read."""
        source = (link.peer_id, event.publisher)
        last = self._sequences.get(source)
        if last is not None and (missed := (event.sequence - last - 1) & wire.SEQUENCE_MASK):
            if missed > _HALF:  # a new connection begins with what is kept for latecomers
                return
            self.lost += missed
        self._sequences[source] = event.sequence
        self._deliver(event.body, read)

    def announced(self, link: SubscriptionLink, publishers: list[Publishing]) -> None:
        """A process has said who publishes the topic there."""
        self.forget(link)
        numbers = {each.number for each in publishers}
        self.forget_counts(lambda peer_id, n: peer_id == link.peer_id and n not in numbers)
        for each in publishers:
            if self._matches(each):
                self.publishers[link, each.number] = each.publisher
        self.matches_changed()

    def forget(self, link: SubscriptionLink) -> None:
        """A process publishes nothing any more, or says anew what it does."""
        for source in [each for each in self.publishers if each[0] is link]:
            del self.publishers[source]
            self.matches_changed()

    def forget_counts(self, of: Callable[[bytes, int], bool]) -> None:
        """Forget what came last of publishers that are gone for good."""
        for source in [each for each in self._sequences if of(*each)]:
            del self._sequences[source]

    def refuses(self, publisher: TopicEndpoint) -> bool:
        """Whether a publisher does not match; says so, once for each."""
        mismatch = wire.mismatch_of(publisher, self.named)
        if mismatch is not None:
            if self._on_mismatch is None:
                self._tell(publisher, _unmatched(publisher, self.named, mismatch))
            elif self._is_new(publisher):
                self._topics.soon(partial(self._on_mismatch, mismatch))
        return mismatch is not None

    def close(self) -> None:
        """Want no more messages."""
        self._topics.subscription_closed(self)

    def _matches(self, each: Publishing) -> bool:
        if each.refusal:
            self._tell(each.publisher, each.refusal)
            return False
        return not self.refuses(each.publisher)

    def _tell(self, about: object, warning: str) -> None:
        if self._is_new(about):
            log.warning("%s", warning)

    def _is_new(self, about: object) -> bool:
        """Whether nothing was said of it yet."""
        if about in self._told or len(self._told) >= MOST_TOLD:
            return False
        self._told.add(about)
        return True


class SubscriptionLink:
    """This process's subscriptions at one other process."""

    def __init__(self, context: TopicsContext, address: Address) -> None:
        self.address = address
        self.peer_id = b""
        """The program at the other end, once connected."""
        self.subscriptions: dict[int, LocalSubscription] = {}
        """Those that want something of that process."""
        self._context = context
        self._connection: CallingConnection | None = None
        self._is_answered = self._has_too_many = False
        self._mute = context.id
        """A program that is not asked: ourselves, by another address, or one without topics."""
        self._task = context.loop.create_task(self._keep())

    def want(self, subscriptions: Iterable[LocalSubscription]) -> None:
        """Subscribe, now or as soon as there is a connection."""
        for each in subscriptions:
            if each.number in self.subscriptions:
                continue
            if len(self.subscriptions) >= wire.MAX_SUBSCRIPTIONS:
                self._tell_of_too_many(each)
                return
            self.subscriptions[each.number] = each
            self._subscribe(each)

    def forget(self, subscription: LocalSubscription) -> None:
        """Unsubscribe."""
        if self.subscriptions.pop(subscription.number, None) is not None and self._connection:
            self._connection.say(lambda session: wire.unsubscribe(session, subscription.number))

    def publishers_received(self, event: PublishersReceived) -> None:
        """The process has said who publishes a topic there."""
        self._is_answered = True
        subscription = self.subscriptions.get(event.subscription_id)
        if subscription is not None:
            subscription.announced(self, event.publishers)

    def published(self, event: MessageReceived, read: int) -> None:
        """A message came, with others of the same read."""
        subscription = self.subscriptions.get(event.subscription_id)
        if subscription is not None:
            subscription.arrived(self, event, read)

    @property
    def is_connected(self) -> bool:
        """Whether it has a connection."""
        return self._connection is not None

    def close(self) -> asyncio.Task[None]:
        """Look for the process no more."""
        self._forget_counts()
        for subscription in list(self.subscriptions.values()):
            self.forget(subscription)
        if self._connection is not None:
            self._connection.link = None
        self._task.cancel()
        return self._task

    async def _keep(self) -> None:
        loop, failures, said = self._context.loop, 0, ""
        while True:
            try:
                connection = await self._context.dialler.connection(self.address, None)
            except TaskRpcError as error:
                if said != str(error):
                    said = str(error)
                    is_away = isinstance(error, ConnectionLost)  # and may come at any time
                    log.log(logging.DEBUG if is_away else logging.WARNING, "%s", error)
            else:
                said, began = "", loop.time()
                await self._use(connection)
                self._context.availability.notify()  # perhaps it is dialled in vain from now on
                if loop.time() - began >= STEADY:
                    failures = 0
                    continue
            await asyncio.sleep(reconnect_delay(failures, random.random()))
            failures += 1

    async def _use(self, connection: CallingConnection) -> None:
        """Have a connection until it ends."""
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
        # One of whom nothing comes any more may only have lost its network.
        has_spoken = connection.received > received and not self._is_answered
        if has_spoken and isinstance(connection.why_closed, ProtocolError):
            self._mute = self.peer_id  # or calls to it would break off, too
            log.warning(
                "%s has no topics: it ended the connection when it was asked for one (%s)",
                self.address.place,
                connection.why_closed,
            )

    def _forget_counts(self) -> None:
        for subscription in self.subscriptions.values():
            subscription.forget_counts(lambda peer_id, _: peer_id == self.peer_id)

    def _tell_of_too_many(self, first: LocalSubscription) -> None:
        if not self._has_too_many:
            self._has_too_many = True
            log.warning(
                "%s has %d subscriptions of this program, the most it takes; %s is one more",
                self.address.place,
                len(self.subscriptions),
                first.named.name,
            )

    def _subscribe(self, subscription: LocalSubscription) -> None:
        if self._connection is not None and self.peer_id != self._mute:
            number, wanted = subscription.number, subscription.named
            self._connection.say(lambda session: wire.subscribe(session, number, wanted))


def _nothing() -> None:
    """Nobody wants to know."""


def _unmatched(publisher: TopicEndpoint, wanted: TopicEndpoint, mismatch: str) -> str:
    topic = publisher.name
    if mismatch == "TYPE":
        return (
            f"{publisher.node} publishes {topic} as {publisher.type_name} with the hash"
            f" {publisher.type_hash[:15]}…; {wanted.node} subscribes to it as {wanted.type_name}"
            f" with {wanted.type_hash[:15]}…: nothing is received from it"
        )
    return (
        f"New publisher discovered on topic '{topic}', offering incompatible QoS. No messages will"
        f" be received from it. Last incompatible policy: {mismatch}"
    )
