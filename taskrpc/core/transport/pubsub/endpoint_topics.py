"""The topics of an endpoint: its publishers and subscriptions, and the remote subscriptions."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import Deliver, OnMismatch
from taskrpc.core.transport.pubsub.publishing import (
    LocalPublisher,
    RemoteSubscriber,
    RemoteSubscription,
)
from taskrpc.core.transport.pubsub.subscribing import (
    LocalSubscription,
    SubscriptionLink,
    TopicsContext,
)
from taskrpc.core.wire import topics as wire
from taskrpc.core.wire.messages import TopicEndpoint

if TYPE_CHECKING:
    from taskrpc.core.transport.connection.server_side import ServingConnection, SubscriberEvents

_Item = TypeVar("_Item")


class Topics:
    """Matches publishers and subscriptions: those of this process, and remote ones.

    A link goes to each process that publishes a topic with a subscription here.
    """

    def __init__(self, context: TopicsContext) -> None:
        self._context = context
        self._local_publishers: dict[str, dict[LocalPublisher, None]] = {}
        self._remote_subscriptions: dict[str, dict[RemoteSubscription, None]] = {}
        self._local_subscriptions: dict[str, dict[LocalSubscription, None]] = {}
        self._links: dict[str, SubscriptionLink] = {}
        """The links by address."""
        self._last_subscription = 0
        """The number of the newest subscription of this process."""
        self._last_publisher = 0
        """The number of the newest publisher; 16 bits of it are sent with messages."""
        self._changed: dict[str, None] = {}
        """Topics whose publishers must be announced."""
        self._search: asyncio.Task[None] | None = None
        """Searches for publishers, as long as there is a subscription."""
        self._will_look = False

    def soon(self, action: Callable[[], object]) -> None:
        """Call a function in a later turn of the loop."""
        self._context.loop.call_soon(action)

    # Publishers

    def create_publisher(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        role: Role,
        on_mismatch: OnMismatch | None = None,
    ) -> LocalPublisher:
        """Create a publisher, and match it with the known subscriptions."""
        number = self._number_for(named.name)
        each = LocalPublisher(self, named, msg_type, number, role, on_mismatch)
        _put(self._local_publishers, named.name, each)
        for local in self._local_subscriptions.get(named.name, ()):
            self._match_here(each, local)
        for remote in self._remote_subscriptions.get(named.name, ()):
            remote.match(each)
        self._announce_soon(named.name)
        return each

    def _number_for(self, topic: str) -> int:
        """Return a number that no publisher of the topic has, and none had recently."""
        self._last_publisher += 1
        if self._last_publisher > wire.PUBLISHER_MASK:
            taken = {each.number for each in self._local_publishers.get(topic, ())}
            while self._last_publisher & wire.PUBLISHER_MASK in taken:
                self._last_publisher += 1
        return self._last_publisher & wire.PUBLISHER_MASK

    def publisher_closed(self, publisher: LocalPublisher) -> None:
        """Remove a publisher."""
        named = publisher.named
        if _drop(self._local_publishers, named.name, publisher):
            for subscription in publisher.local:
                del subscription.publishers[publisher, 0]
                subscription.matches_changed()
            for feed in publisher.feeds.values():
                publisher.lost += len(feed.waiting)
                feed.drop_waiting()
            self._announce_soon(named.name)

    def liveliness_changed(self, publisher: LocalPublisher) -> None:
        """Tell the subscriptions whether a publisher is alive."""
        for subscription in publisher.local:
            subscription.publishers[publisher, 0] = publisher.alive
            subscription.matches_changed()
        self._announce_soon(publisher.named.name)

    def subscriber_of(self, connection: ServingConnection) -> SubscriberEvents:
        """Return the subscriber of a connection: the topics of its caller."""
        if connection.subscriber is None:
            connection.subscriber = RemoteSubscriber(self, connection)
        return connection.subscriber

    def subscribed(self, subscription: RemoteSubscription) -> None:
        """Add a subscription of another process."""
        topic = subscription.wanted.name
        _put(self._remote_subscriptions, topic, subscription)
        publishers = list(self._local_publishers.get(topic, ()))
        subscription.announce(publishers)
        for each in publishers:
            subscription.match(each)

    def unsubscribed(self, subscription: RemoteSubscription) -> None:
        """Remove a subscription of another process."""
        topic = subscription.wanted.name
        _drop(self._remote_subscriptions, topic, subscription)
        for publisher in self._local_publishers.get(topic, ()):
            publisher.unfeed(subscription)

    def role_changed(self, subscription: RemoteSubscription) -> None:
        """Stop the publishers that the subscriber's new role may not see."""
        for publisher in self._local_publishers.get(subscription.wanted.name, ()):
            if subscription.refusal(publisher):
                publisher.unfeed(subscription)

    def _announce_soon(self, topic: str) -> None:
        """Announce the publishers of a topic, once in a turn of the loop."""
        if not self._changed:
            self.soon(self.announce_changed)
        self._changed[topic] = None

    def announce_changed(self) -> None:
        """Announce changed publishers to the subscriptions of other processes."""
        changed, self._changed = self._changed, {}
        for topic in changed:
            publishers = list(self._local_publishers.get(topic, ()))
            for each in publishers:
                each.is_announced = True
            for subscription in self._remote_subscriptions.get(topic, ()):
                subscription.announce(publishers)

    # Subscriptions

    def create_subscription(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None = None,
    ) -> LocalSubscription:
        """Create a subscription, and search for publishers of its topic."""
        self._last_subscription += 1
        each = LocalSubscription(
            self, named, msg_type, self._last_subscription, deliver, on_mismatch
        )
        _put(self._local_subscriptions, named.name, each)
        for publisher in self._local_publishers.get(named.name, ()):
            self._match_here(publisher, each)
        if self._search is None:
            self._search = self._context.loop.create_task(self._searched())
        elif not self._will_look:  # once for all subscriptions of one turn
            self._will_look = True
            self.soon(self._look)
        return each

    def subscription_closed(self, subscription: LocalSubscription) -> None:
        """Remove a subscription."""
        named = subscription.named
        if _drop(self._local_subscriptions, named.name, subscription):
            for publisher in self._local_publishers.get(named.name, ()):
                if subscription in publisher.local:
                    del publisher.local[subscription]
                    publisher.matches_changed()
            for link in self._links.values():
                link.forget(subscription)
            if not self._local_subscriptions and self._search is not None:
                self._search.cancel()
                self._search = None
                self._drop_links(set())

    async def close(self) -> None:
        """End the search and all links."""
        self._local_subscriptions.clear()
        tasks = [link.close() for link in self._links.values()]
        self._links.clear()
        if self._search is not None:
            self._search.cancel()
            tasks.append(self._search)
        if tasks:
            await asyncio.wait(tasks)

    def _match_here(self, publisher: LocalPublisher, subscription: LocalSubscription) -> None:
        if subscription.refuses(publisher.named):
            publisher.refuses(subscription.named, "of this process")
            return
        publisher.local[subscription] = None
        publisher.matches_changed()
        subscription.publishers[publisher, 0] = publisher.alive
        subscription.matches_changed()
        if subscription.named.latched and publisher.latched is not None:
            for _, body in list(publisher.latched)[-subscription.named.depth :]:
                subscription.arrived_here(body)

    async def _searched(self) -> None:
        """Search for publishers after each change of the registry."""
        while True:
            mark = self._context.availability.mark()
            self._look()
            await self._context.availability.wait(mark, None, poll_fast=False)

    def _look(self) -> None:
        self._will_look = False
        if not self._local_subscriptions:
            return
        context = self._context
        there = set()
        for address, topics in context.network.publishing(self._local_subscriptions):
            if address.text == context.address:
                continue
            there.add(address.text)
            link = self._links.get(address.text)
            if link is None:
                link = self._links[address.text] = SubscriptionLink(context, address)
            link.address = address
            for topic in topics:
                link.want(self._local_subscriptions[topic])
        self._drop_links(there)

    def _drop_links(self, there: set[str]) -> None:
        """Close the links to processes that no longer publish, unless they are still connected."""
        for text, link in list(self._links.items()):
            if text not in there and not (link.subscriptions and link.is_connected):
                del self._links[text]
                link.close()


def _put(items: dict[str, dict[_Item, None]], topic: str, item: _Item) -> None:
    items.setdefault(topic, {})[item] = None


def _drop(items: dict[str, dict[_Item, None]], topic: str, item: _Item) -> bool:
    """Remove an item; return whether it was there."""
    of_topic = items.get(topic, {})
    if item not in of_topic:
        return False
    del of_topic[item]
    if not of_topic:
        del items[topic]
    return True
