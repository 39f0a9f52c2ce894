"""The topics of an endpoint: who publishes what here, who wants it, and who must be asked."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from taskrpc.security.roles import Role
from taskrpc.transport.base import Deliver, OnMismatch
from taskrpc.transport.discovery.entries import EntryChange
from taskrpc.transport.pubsub.publishing import LocalPublisher, RemoteSubscriber, RemoteSubscription
from taskrpc.transport.pubsub.subscribing import LocalSubscription, SubscriptionLink, TopicsContext
from taskrpc.wire import topics as wire
from taskrpc.wire.messages import TopicEndpoint

if TYPE_CHECKING:
    from taskrpc.transport.connection.server_side import ServingConnection, SubscriberEvents

_Item = TypeVar("_Item")


class Topics:
    """Matches publishers and subscriptions, those of this process and those of others."""

    def __init__(self, home: TopicsContext) -> None:
        self._home = home
        self._publications: dict[str, dict[LocalPublisher, None]] = {}
        self._wanted: dict[str, dict[RemoteSubscription, None]] = {}
        self._receptions: dict[str, dict[LocalSubscription, None]] = {}
        self._links: dict[str, SubscriptionLink] = {}
        self._numbers = 0
        self._publishers = 0
        self._changed: dict[str, None] = {}
        self._search: asyncio.Task[None] | None = None
        self._will_look = False

    def soon(self, action: Callable[[], object]) -> None:
        """Do something in a later turn of the loop."""
        self._home.loop.call_soon(action)

    # Publishers

    def publication(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        role: Role,
        on_mismatch: OnMismatch | None = None,
    ) -> LocalPublisher:
        """A new publisher's way to its subscriptions."""
        self._home.publish(EntryChange(publisher=named))
        number = self._number_for(named.name)
        each = LocalPublisher(self, named, msg_type, number, role, on_mismatch)
        _put(self._publications, named.name, each)
        for reception in self._receptions.get(named.name, ()):
            self._match_here(each, reception)
        for subscription in self._wanted.get(named.name, ()):
            subscription.match(each)
        self._announce_soon(named.name)
        return each

    def _number_for(self, topic: str) -> int:
        """One that no other publisher of the topic has, and none had lately."""
        self._publishers += 1
        if self._publishers > wire.PUBLISHER_MASK:
            taken = {each.number for each in self._publications.get(topic, ())}
            while self._publishers & wire.PUBLISHER_MASK in taken:
                self._publishers += 1
        return self._publishers & wire.PUBLISHER_MASK

    def publication_closed(self, publication: LocalPublisher) -> None:
        """A publisher is gone."""
        named = publication.named
        if _drop(self._publications, named.name, publication):
            for reception in publication.local:
                del reception.publishers[publication, 0]
                reception.matches_changed()
            for feed in publication.feeds.values():
                publication.lost += len(feed.waiting)
                feed.drop_waiting()
            self._home.publish(EntryChange(publisher=named, gone=True))
            self._announce_soon(named.name)

    def subscriber_of(self, connection: ServingConnection) -> SubscriberEvents:
        """What the caller of a connection has subscribed to."""
        if connection.subscriber is None:
            connection.subscriber = RemoteSubscriber(self, connection)
        return connection.subscriber

    def subscribed(self, subscription: RemoteSubscription) -> None:
        """Another process wants a topic."""
        topic = subscription.wanted.name
        _put(self._wanted, topic, subscription)
        publications = list(self._publications.get(topic, ()))
        subscription.announce(publications)
        for each in publications:
            subscription.match(each)

    def unsubscribed(self, subscription: RemoteSubscription) -> None:
        """Another process wants a topic no more."""
        topic = subscription.wanted.name
        _drop(self._wanted, topic, subscription)
        for publication in self._publications.get(topic, ()):
            publication.unfeed(subscription)

    def role_changed(self, subscription: RemoteSubscription) -> None:
        """The caller may see less than before."""
        for publication in self._publications.get(subscription.wanted.name, ()):
            if subscription.refusal(publication):
                publication.unfeed(subscription)

    def _announce_soon(self, topic: str) -> None:
        """Once, however many publishers come and go in one turn."""
        if not self._changed:
            self.soon(self.announce_changed)
        self._changed[topic] = None

    def announce_changed(self) -> None:
        """Tell subscriptions of other processes who publishes their topics now."""
        changed, self._changed = self._changed, {}
        for topic in changed:
            publications = list(self._publications.get(topic, ()))
            for each in publications:
                each.is_announced = True
            for subscription in self._wanted.get(topic, ()):
                subscription.announce(publications)

    # Subscriptions

    def reception(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None = None,
    ) -> LocalSubscription:
        """A new subscription's way to the publishers of its topic."""
        self._home.publish(EntryChange(subscription=named))
        self._numbers += 1
        each = LocalSubscription(self, named, msg_type, self._numbers, deliver, on_mismatch)
        _put(self._receptions, named.name, each)
        for publication in self._publications.get(named.name, ()):
            self._match_here(publication, each)
        if self._search is None:
            self._search = self._home.loop.create_task(self._searched())
        elif not self._will_look:  # once, however many subscriptions are made in one turn
            self._will_look = True
            self.soon(self._look)
        return each

    def reception_closed(self, reception: LocalSubscription) -> None:
        """A subscription is gone."""
        named = reception.named
        if _drop(self._receptions, named.name, reception):
            for publication in self._publications.get(named.name, ()):
                if reception in publication.local:
                    del publication.local[reception]
                    publication.matches_changed()
            for link in self._links.values():
                link.forget(reception)
            self._home.publish(EntryChange(subscription=named, gone=True))
            if not self._receptions and self._search is not None:
                self._search.cancel()
                self._search = None
                self._drop_links(set())

    async def close(self) -> None:
        """End the search and all links."""
        self._receptions.clear()
        tasks = [link.close() for link in self._links.values()]
        self._links.clear()
        if self._search is not None:
            self._search.cancel()
            tasks.append(self._search)
        if tasks:
            await asyncio.wait(tasks)

    def _match_here(self, publication: LocalPublisher, reception: LocalSubscription) -> None:
        if reception.refuses(publication.named):
            publication.refuses(reception.named, "of this process")
            return
        publication.local[reception] = None
        publication.matches_changed()
        reception.publishers[publication, 0] = publication.named
        reception.matches_changed()
        if reception.named.latched and publication.latched is not None:
            for _, body in list(publication.latched)[-reception.named.depth :]:
                reception.arrived_here(body)

    async def _searched(self) -> None:
        """Look who publishes, whenever that may have changed."""
        while True:
            mark = self._home.availability.mark()
            self._look()
            await self._home.availability.wait(mark, None, hurried=False)

    def _look(self) -> None:
        self._will_look = False
        if not self._receptions:
            return
        home = self._home
        there = set()
        for address, topics in home.network.publishing(self._receptions):
            if address.place == home.address:
                continue
            there.add(address.place)
            link = self._links.get(address.place)
            if link is None:
                link = self._links[address.place] = SubscriptionLink(home, address)
            link.address = address
            for topic in topics:
                link.want(self._receptions[topic])
        self._drop_links(there)

    def _drop_links(self, there: set[str]) -> None:
        """A process that is known no more may still be connected, and have something to say."""
        for place, link in list(self._links.items()):
            if place not in there and not (link.receptions and link.is_connected):
                del self._links[place]
                link.close()


def _put(items: dict[str, dict[_Item, None]], topic: str, item: _Item) -> None:
    items.setdefault(topic, {})[item] = None


def _drop(items: dict[str, dict[_Item, None]], topic: str, item: _Item) -> bool:
    """Returns whether it was there."""
    of_topic = items.get(topic, {})
    if item not in of_topic:
        return False
    del of_topic[item]
    if not of_topic:
        del items[topic]
    return True
