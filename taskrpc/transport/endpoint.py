"""What one event loop has in a network: its services, clients and connections."""

from __future__ import annotations

import asyncio
import itertools
import logging
import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import msgspec

from taskrpc import platform
from taskrpc.errors import (
    ConnectionLost,
    NameInUse,
    PermissionDenied,
    ServiceUnavailable,
    TaskRpcError,
)
from taskrpc.request_ids.ids import RequestCounters
from taskrpc.security.roles import Role
from taskrpc.transport.base import Offer
from taskrpc.transport.channel import RemoteChannel
from taskrpc.transport.codec import ServiceType
from taskrpc.transport.connection.client_side import CallingConnection
from taskrpc.transport.connection.connection import READ_BUFFER, Connection, Traffic
from taskrpc.transport.connection.deadline_timer import clock_of
from taskrpc.transport.connection.dialling import READY_TIMEOUT, Dialler, placed
from taskrpc.transport.connection.threads import ThreadHandoff
from taskrpc.transport.discovery.availability import Availability
from taskrpc.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry, entry_of
from taskrpc.transport.discovery.registry import this_process
from taskrpc.transport.limits.keepalive import DEFAULT, Keepalive
from taskrpc.transport.limits.log_throttling import LimitedLog
from taskrpc.transport.network import Address, Network
from taskrpc.wire.handshake import Identity
from taskrpc.wire.messages import DEFAULT_LIMITS, Listing, Resolve, ServiceEndpoint, TopicEndpoint

if TYPE_CHECKING:
    from taskrpc.observer import Connections
    from taskrpc.transport.connection.server_side import ServingConnection
    from taskrpc.transport.limits.admission import Admission
    from taskrpc.transport.limits.backpressure import Backpressure
    from taskrpc.transport.limits.calls_in_flight import CallsInFlight
    from taskrpc.transport.pubsub.endpoint_topics import Topics
    from taskrpc.transport.pubsub.publishing import LocalPublisher
    from taskrpc.transport.pubsub.subscribing import LocalSubscription

log = logging.getLogger("taskrpc.transport")

TICK = 1.0
SLICE, SLICES = 64, 20
"""Connections that are looked after at once, where there are no more than both multiplied."""
LISTING_TIMEOUT = 2.0
CLOSE_TIMEOUT = 1.0


class Endpoint(ThreadHandoff):
    """The `Transport` that frames travel on; shared by the nodes of one loop and network.

    `forget` is called when the last holder has gone and nobody may join any more. `threads` says
    that other threads call too.
    """

    def __init__(
        self,
        network: Network,
        forget: Callable[[], object] = lambda: None,
        *,
        keepalive: Keepalive = DEFAULT,
        threads: bool = False,
    ) -> None:
        super().__init__()
        self.keepalive = keepalive
        self._has_threads = threads
        self._calling = _calling_class(threads=threads)
        self.now = clock_of(self.loop)
        self.network = network
        self.availability = Availability(network)
        self.dialler = Dialler(network, self._caller)
        self.read_buffer = memoryview(bytearray(READ_BUFFER))
        platform.keep_freed_memory(DEFAULT_LIMITS.body)
        self.address = ""
        self.holders = 1
        self.id = os.urandom(16)
        self.call_numbers = itertools.count(1)
        self.counters = RequestCounters(lambda: os.urandom(16))
        self.backpressure: Backpressure
        """Made by `_take_connections`, as `calls_in_flight` is: many programs only call."""
        self.calls_in_flight: CallsInFlight
        self.refusals = LimitedLog(log)
        self._offers = OfferTable()
        self.offers = self._offers.by_method
        self._own_entry = TrackedEntry(this_process())
        self._served: dict[ServingConnection, None] = {}  # in order of arrival
        self._admission: Admission | None = None
        self._ticker: asyncio.TimerHandle | None = None
        self._forget = forget
        self._advertising = self._closed = False
        self._called, self._calls = Traffic(), Traffic()
        self._topics: Topics | None = None

    # Transport: nodes, services, clients, topics

    def add_node(self, name: str) -> None:
        """Announce a node."""
        self.publish(EntryChange(node=name))

    def remove_node(self, name: str) -> None:
        """Withdraw a node's announcement."""
        self.publish(EntryChange(node=name, gone=True))

    def offer(self, offer: Offer) -> None:
        """Take calls for a service."""
        self._take_connections()
        self._offers.add(offer)
        try:
            self.publish(EntryChange(service=_named(offer)), claim="" if offer.join else offer.name)
        except BaseException:
            self._offers.remove(offer)
            raise
        self._advertise()

    def withdraw(self, offer: Offer) -> None:
        """Stop taking calls for a service."""
        if self._offers.remove(offer):
            self.publish(EntryChange(service=_named(offer), gone=True))
            self._advertise()

    def add_server(self, server: ServiceEndpoint) -> None:
        """Announce another server of a service of this process; it takes no calls itself."""
        self.publish(EntryChange(service=server))

    def remove_server(self, server: ServiceEndpoint) -> None:
        """Withdraw such an announcement."""
        self.publish(EntryChange(service=server, gone=True))

    def replace(self, offer: Offer, by: Offer) -> None:
        """Take the calls that come from now on for another offer of the same service."""
        if self._offers.remove(offer):
            self._offers.add(by)
            self._advertise()

    def channel(
        self, name: str, srv_type: ServiceType, node: str, *, otherwise: str = ""
    ) -> RemoteChannel:
        """A way to call a service for a node; the service `otherwise` where nobody offers it."""
        named = ServiceEndpoint(name, srv_type._TYPE, srv_type._HASH, node)
        self.publish(EntryChange(client=named))
        return RemoteChannel(self, named, srv_type, otherwise=otherwise)

    def channel_closed(self, named: ServiceEndpoint) -> None:
        """A client is gone."""
        self.publish(EntryChange(client=named, gone=True))

    def create_publisher(
        self, named: TopicEndpoint, msg_type: Any, role: Role, on_mismatch: Any = None
    ) -> LocalPublisher:
        """A publisher's way to its subscriptions."""
        self._take_connections()
        return self.topics.create_publisher(named, msg_type, role, on_mismatch)

    def create_subscription(
        self, named: TopicEndpoint, msg_type: Any, deliver: Any, on_mismatch: Any = None
    ) -> LocalSubscription:
        """A subscription's way to the publishers of its topic."""
        return self.topics.create_subscription(named, msg_type, deliver, on_mismatch)

    @property
    def topics(self) -> Topics:
        """What is published and subscribed here."""
        if self._topics is None:
            from taskrpc.transport.pubsub.endpoint_topics import Topics  # most programs have none

            self._topics = Topics(self)
        return self._topics

    # Transport: the graph

    async def graph(self) -> list[RegistryEntry]:
        """Every process that can be seen, unreachable peers left out."""
        asked = [self._list_peer(address) for address in self.network.peers()]
        remote = await asyncio.gather(*asked)
        return self.network.entries() + [entry for entry in remote if entry is not None]

    async def definition(self, name: str) -> tuple[str, str]:
        """A service's type and the full text of its definition.

        Raises ServiceUnavailable when nobody offers it, or what stood in the way of asking.
        """
        deadline = self.loop.time() + READY_TIMEOUT
        problem: TaskRpcError = ServiceUnavailable(f"nobody offers {name}")
        for address in self.network.locate(name):
            try:
                connection = await self.dialler.connection(address, deadline)
                asked = connection.resolve(Resolve(name), deadline, definition=True)
                resolved = await asked.future
            except TaskRpcError as error:
                if not isinstance(error, ServiceUnavailable):
                    problem = error
            else:
                return resolved.type_name, resolved.definition
        raise problem

    def traffic(self) -> tuple[str, Connections, Connections]:
        """Which endpoint this is, and what it has accepted and dialled."""
        dialled = self._calls.counts(self.dialler.connections)
        return self.id.hex(), self._called.counts(self._served), dialled

    # Transport: ends

    async def release(self) -> None:
        """Give up one holder's share; the last one closes everything."""
        self.holders -= 1
        if self.holders:
            return
        self._closed = True
        self._forget()
        try:
            if self._topics is not None:
                await self._topics.close()
            await self.network.stop_listening()
            for served in list(self._served):
                served.drain()
            await self.dialler.close()
            await self._ends(CLOSE_TIMEOUT)
            for connection in self._connections():
                connection.abort(ConnectionLost("the node was destroyed"))
            await self._ends(CLOSE_TIMEOUT)
            if self._ticker is not None:
                self._ticker.cancel()
        finally:  # whoever waits may be cancelled, as a callback is that destroys its own node
            self.network.close()

    # Host: what connections ask

    def method_of(self, name: str) -> int:
        """The method id of a service, 0 if there is none."""
        return self._offers.method_of(name)

    def listing(self) -> Listing:
        """Everything that this process offers."""
        entry = self._own_entry.entry()
        return Listing(
            list(entry.nodes),
            list(entry.services),
            list(entry.clients),
            list(entry.publishers),
            list(entry.subscriptions),
        )

    def caller_proved(self, connection: ServingConnection) -> None:
        """A caller has proved that he may be here."""
        if self._admission is not None:
            self._admission.proved(connection)

    def connection_began(self, connection: Connection) -> None:
        """A connection has its transport."""
        self._traffic_of(connection).began()
        if connection.serves:
            served = cast("ServingConnection", connection)
            self._served[served] = None
            if self._admission is not None and connection.transport is not None:
                self._admission.came(served, connection.transport.get_extra_info("peername"))
        elif isinstance(connection, CallingConnection):
            self.dialler.connections[connection] = None
        self._identify(connection)
        self._look_again()

    def connection_ended(self, connection: Connection) -> None:
        """A connection is gone."""
        self._traffic_of(connection).left(connection)
        if connection.serves:
            served = cast("ServingConnection", connection)
            self._served.pop(served, None)
            if self._admission is not None:
                self._admission.left(served)
        elif isinstance(connection, CallingConnection):
            self.dialler.ended(connection)

    # Inside

    def _take_connections(self) -> None:
        """Listen, from the first service or publisher on."""
        if not self.address:
            from taskrpc.transport.limits.admission import Admission
            from taskrpc.transport.limits.backpressure import Backpressure
            from taskrpc.transport.limits.calls_in_flight import CallsInFlight

            self.backpressure, self.calls_in_flight, self._admission = (
                Backpressure(),
                CallsInFlight(),
                Admission(),
            )
            self.address = self.network.listen(self._accepted)
            if self._watches_files:  # they may change before the first connection
                self._look_again()

    @property
    def _watches_files(self) -> bool:
        accounts = self.network.accounts
        return bool(self.network.certificate) or (accounts is not None and accounts.may_change)

    def _traffic_of(self, connection: Connection) -> Traffic:
        return self._called if connection.serves else self._calls

    def _caller(self, address: Address) -> CallingConnection:
        name = self._own_entry.first_node or self._own_entry.about.script
        me = self._identity(address.token, name)
        if address.domain is not None:
            me = msgspec.structs.replace(me, domain=address.domain)
        return self._calling(self, me, self.availability.notify)

    def _accepted(self) -> ServingConnection:
        me, accounts = self._identity(self.network.token, ""), self.network.accounts
        if accounts is not None:
            if self._ticker is None:  # nobody was here to look after
                accounts.refresh()
            me = msgspec.structs.replace(me, accounts=accounts.current, today=time.time())
        return _serving_class(threads=self._has_threads)(self, me)

    def _identity(self, token: bytes, name: str) -> Identity:
        return Identity(self.id, os.urandom(16), token, self.network.domain, name)

    def _identify(self, connection: Connection) -> None:
        if connection.transport is None:
            return
        try:
            credentials = self.network.peer_credentials(
                connection.transport, serving=connection.serves
            )
        except PermissionDenied as error:
            connection.abort(error)
            log.warning("closed the connection of another user: %s", error)
        else:
            binding = self.network.channel_binding(connection.transport, serving=connection.serves)
            connection.session.set_peer_credentials(credentials, binding)

    def publish(self, change: EntryChange, *, claim: str = "") -> None:
        """Tell everybody of a change to what this process has."""
        if self._closed:
            return
        about = self._own_entry.about
        if (self.address, self.network.certificate) != (about.address, about.certificate):
            change = msgspec.structs.replace(
                change,
                address=self.address,
                token=self.network.token.hex(),
                certificate=self.network.certificate,
            )
        self.network.publish(self._own_entry, change, claim=claim)

    def _advertise(self) -> None:
        """Tell callers of changed services: once, however many change in one turn of the loop."""
        if self._served and not self._advertising:
            self._advertising = True
            self.loop.call_soon(self._advertise_now)

    def _advertise_now(self) -> None:
        self._advertising = False
        for connection in list(self._served):
            connection.session.advertise()
            connection.flush()

    async def _list_peer(self, address: Address) -> RegistryEntry | None:
        deadline = self.loop.time() + LISTING_TIMEOUT
        try:
            connection = await self.dialler.connection(address, deadline)
            listing = await connection.resolve(Resolve(""), deadline).future
        except TaskRpcError as error:
            log.warning("%s", placed(address.place, error))
            return None
        return entry_of(address.place, listing)

    def _connections(self) -> list[Connection]:
        return [*self._served, *self.dialler.connections]

    async def _ends(self, timeout: float) -> None:
        """Wait for connections to close: transports must learn it while the loop still runs."""
        ends = [connection.gone for connection in self._connections()]
        if ends:
            await asyncio.wait(ends, timeout=timeout)

    def _tick(self) -> None:
        self._ticker = None
        connections = self._connections()
        # First: whatever fails below, revoked accounts must be found a second later.
        if connections or (self.address and self._watches_files):
            self._look_again()
        if self._admission is not None:
            self.backpressure.measure_all()
            self.calls_in_flight.settle()
        # Thousands have their pings, and the time that this takes, spread over the second.
        slices = min(SLICES, 1 + len(connections) // SLICE)
        for number in range(1, slices):
            part = connections[number::slices]
            self.loop.call_later(TICK * number / slices, self._look_after, part)
        self._look_after(connections[::slices])
        if (accounts := self.network.accounts) is not None:
            accounts.refresh()
            for served in list(self._served):
                served.check_account(accounts.current, time.time())
        if self.address and self.network.certificate != self._own_entry.about.certificate:
            self.publish(EntryChange())

    def _look_again(self) -> None:
        if self._ticker is None and not self._closed:
            self._ticker = self.loop.call_later(TICK, self._tick)

    def _look_after(self, connections: list[Connection]) -> None:
        now = self.loop.time()
        for connection in connections:
            connection.tick(now)


def _calling_class(*, threads: bool) -> type[CallingConnection]:
    if not threads:
        return CallingConnection
    from taskrpc.transport.connection.client_threads import ThreadedConnection

    return ThreadedConnection


def _serving_class(*, threads: bool) -> type[ServingConnection]:
    if not threads:
        from taskrpc.transport.connection.server_side import ServingConnection

        return ServingConnection
    from taskrpc.transport.connection.server_threads import ThreadedServing

    return ThreadedServing


def _named(offer: Offer) -> ServiceEndpoint:
    return ServiceEndpoint(offer.name, offer.srv_type._TYPE, offer.srv_type._HASH, offer.node)


class OfferTable:
    """At most one offer of a name; a number is never given twice."""

    def __init__(self) -> None:
        self.by_method: dict[int, Offer] = {}
        self._methods: dict[str, int] = {}
        self._last = 0

    def method_of(self, name: str) -> int:
        """The number of a service, 0 if there is none."""
        return self._methods.get(name, 0)

    def add(self, offer: Offer) -> None:
        """One more; raises NameInUse where its name is taken."""
        if (method := self.method_of(offer.name)) != 0:
            node = self.by_method[method].node
            raise NameInUse(f"{offer.name} is already offered by the node {node} of this process")
        self._last += 1
        self._methods[offer.name] = self._last
        self.by_method[self._last] = offer

    def remove(self, offer: Offer) -> bool:
        """One less; returns whether it was there."""
        method = self.method_of(offer.name)
        if self.by_method.get(method) is not offer:
            return False
        del self._methods[offer.name], self.by_method[method]
        return True
