"""Registry entries: what a process publishes about itself, as a whole or as changes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TypeVar

import msgspec

from taskrpc.core.wire.messages import Listing, ServiceEndpoint, TopicEndpoint

_Item = TypeVar("_Item", str, ServiceEndpoint, TopicEndpoint)


class RegistryEntry(msgspec.Struct, frozen=True, tag="Entry", dict=True):
    """What one process publishes about itself."""

    pid: int
    """The process id; 0 for a process on another machine."""
    script: str
    folder: str
    """The working folder of the process."""
    since: float
    """Seconds since the epoch."""
    address: str = ""
    """`host:port` or `unix:/path`; empty for a process that only calls."""
    token: str = ""
    """Hexadecimal; the secret that a caller of `address` must prove to know."""
    certificate: str = ""
    """The certificate of the server at `address` (PEM), "" for plain connections."""
    nodes: tuple[str, ...] = ()
    services: tuple[ServiceEndpoint, ...] = ()
    clients: tuple[ServiceEndpoint, ...] = ()
    publishers: tuple[TopicEndpoint, ...] = ()
    subscriptions: tuple[TopicEndpoint, ...] = ()

    def __repr__(self) -> str:
        # Without the token: it must not appear in logs.
        return f"RegistryEntry(pid={self.pid}, script={self.script!r}, address={self.address!r})"

    def offers(self, service: str) -> bool:
        """Whether the process offers a service of this absolute name."""
        return service in self._names

    @cached_property
    def _names(self) -> frozenset[str]:
        return frozenset(endpoint.name for endpoint in self.services)


def entry_of(address: str, listing: Listing) -> RegistryEntry:
    """Return the entry of a process on another machine, made from its listing."""
    return RegistryEntry(
        pid=0,
        script=address,
        folder="",
        since=0.0,
        address=address,
        nodes=tuple(listing.nodes),
        services=tuple(listing.services),
        clients=tuple(listing.clients),
        publishers=tuple(listing.publishers),
        subscriptions=tuple(listing.subscriptions),
    )


class EntryChange(msgspec.Struct, frozen=True, tag="Change", omit_defaults=True):
    """Something that a process has added or removed."""

    node: str = ""
    service: ServiceEndpoint | None = None
    client: ServiceEndpoint | None = None
    publisher: TopicEndpoint | None = None
    subscription: TopicEndpoint | None = None
    gone: bool = False
    """Whether it was removed."""
    address: str = ""
    """Not empty: the process accepts calls at this address now, with this token and certificate."""
    token: str = ""
    certificate: str = ""

    def __repr__(self) -> str:
        # Without the token: it must not appear in logs.
        return f"EntryChange(node={self.node!r}, service={self.service!r}, client={self.client!r})"


class TrackedEntry:
    """A registry entry that is kept up to date; each change takes constant time."""

    def __init__(self, entry: RegistryEntry) -> None:
        self.about = entry
        """Process and address; its lists of nodes, services and topics are out of date."""
        self.services: dict[str, ServiceEndpoint] = {}
        """One server of each service, by absolute name."""
        # Counts, because several nodes of a process can have equal items.
        self._servers: dict[ServiceEndpoint, int] = {}
        self._offered: dict[str, int] = {}
        self._nodes: dict[str, int] = {}
        self._clients: dict[ServiceEndpoint, int] = {}
        self._publishers: dict[TopicEndpoint, int] = {}
        self._subscriptions: dict[TopicEndpoint, int] = {}
        self._topics: dict[str, int] = {}
        self._entry: RegistryEntry | None = entry
        """The whole entry; None after a change until it is needed."""
        for node in entry.nodes:
            _add(self._nodes, node)
        for service in entry.services:
            self._count_server(service, gone=False)
        for client in entry.clients:
            _add(self._clients, client)
        for publisher in entry.publishers:
            self._count_publisher(publisher, gone=False)
        for subscription in entry.subscriptions:
            _add(self._subscriptions, subscription)

    def apply(self, change: EntryChange) -> None:
        """Apply a change."""
        self._entry = None
        if change.address:
            self.about = msgspec.structs.replace(
                self.about,
                address=change.address,
                token=change.token,
                certificate=change.certificate,
            )
        count = _drop if change.gone else _add
        if change.node:
            count(self._nodes, change.node)
        if change.client is not None:
            count(self._clients, change.client)
        if change.publisher is not None:
            self._count_publisher(change.publisher, gone=change.gone)
        if change.subscription is not None:
            count(self._subscriptions, change.subscription)
        if change.service is not None:
            self._count_server(change.service, gone=change.gone)

    @property
    def first_node(self) -> str:
        """The oldest node of the process, "" without nodes."""
        return next(iter(self._nodes), "")

    def offers(self, service: str) -> bool:
        """Whether the process offers a service of this absolute name."""
        return service in self.services

    def publishes(self, topic: str) -> bool:
        """Whether the process publishes a topic of this absolute name."""
        return topic in self._topics

    def entry(self) -> RegistryEntry:
        """The whole entry in its present state."""
        if self._entry is None:
            self._entry = msgspec.structs.replace(
                self.about,
                nodes=tuple(_each(self._nodes)),
                services=tuple(_each(self._servers)),
                clients=tuple(_each(self._clients)),
                publishers=tuple(_each(self._publishers)),
                subscriptions=tuple(_each(self._subscriptions)),
            )
        return self._entry

    def _count_server(self, server: ServiceEndpoint, *, gone: bool) -> None:
        name = server.name
        if not gone:
            _add(self._servers, server)
            _add(self._offered, name)
            self.services[name] = server
            return
        _drop(self._servers, server)
        _drop(self._offered, name)
        self.services.pop(name, None)
        if name in self._offered:  # another node of the process offers the same name; this is rare
            self.services[name] = next(each for each in self._servers if each.name == name)

    def _count_publisher(self, publisher: TopicEndpoint, *, gone: bool) -> None:
        count = _drop if gone else _add
        count(self._publishers, publisher)
        count(self._topics, publisher.name)


def _add(counts: dict[_Item, int], item: _Item) -> None:
    counts[item] = counts.get(item, 0) + 1


def _drop(counts: dict[_Item, int], item: _Item) -> None:
    left = counts.pop(item, 0) - 1
    if left > 0:
        counts[item] = left


def _each(counts: dict[_Item, int]) -> Iterator[_Item]:
    for item, count in counts.items():
        for _ in range(count):
            yield item
