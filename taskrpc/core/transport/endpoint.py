"""One event loop's part of a network: its services, clients, topics and connections."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, Any, TypeVar, cast

import msgspec

from taskrpc.core.request_ids.ids import RequestCounters
from taskrpc.core.security.roles import Role
from taskrpc.core.system import resources
from taskrpc.core.transport.base import (
    CallNumbers,
    Offer,
    ProgramStatistics,
    TopicPublisher,
    TopicSubscription,
)
from taskrpc.core.transport.chance import chance_of
from taskrpc.core.transport.codec import ServiceType
from taskrpc.core.transport.connection.connection import READ_BUFFER, Connection, Traffic
from taskrpc.core.transport.connection.deadline_timer import clock_of
from taskrpc.core.transport.connection.threads import ThreadHandoff
from taskrpc.core.transport.discovery.availability import Availability
from taskrpc.core.transport.discovery.entries import (
    EntryChange,
    RegistryEntry,
    TrackedEntry,
    entry_of,
)
from taskrpc.core.transport.discovery.registry import this_process
from taskrpc.core.transport.limits.keepalive import DEFAULT, Keepalive
from taskrpc.core.transport.limits.log_throttling import LimitedLog
from taskrpc.core.transport.network import Address, NativeSide, Network, no_definition, no_server
from taskrpc.core.transport.offer_table import OfferTable
from taskrpc.core.transport.time_of_day import time_of_day
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.messages import (
    DEFAULT_LIMITS,
    Listing,
    Resolve,
    ServiceEndpoint,
    TopicEndpoint,
)
from taskrpc.errors import (
    ConnectionLost,
    PermissionDenied,
    ServiceUnavailable,
    TaskRpcError,
)

if TYPE_CHECKING:
    from taskrpc.core.observer import Connections
    from taskrpc.core.transport.channel import RemoteChannel
    from taskrpc.core.transport.connection.call_meter import CallMeter
    from taskrpc.core.transport.connection.client_side import CallingConnection
    from taskrpc.core.transport.connection.dialling import Dialler
    from taskrpc.core.transport.connection.incoming_call import RouteFaults
    from taskrpc.core.transport.connection.server_side import ServingConnection
    from taskrpc.core.transport.limits.admission import Admission
    from taskrpc.core.transport.limits.backpressure import Backpressure
    from taskrpc.core.transport.limits.calls_in_flight import CallsInFlight
    from taskrpc.core.transport.pubsub.endpoint_topics import Topics
    from taskrpc.core.wire.statistics import Statistics

log = logging.getLogger("taskrpc.transport")

_Item = TypeVar("_Item", TopicPublisher, TopicSubscription)

TICK = 1.0
"""Seconds between two checks of each connection."""
SLICE, SLICES = 8, 500
"""Connections that are checked at once, and the most groups into which a check is divided: a call
waits until a group is checked."""
LISTING_TIMEOUT = 2.0
"""Seconds for a peer to list its services."""
CLOSE_TIMEOUT = 1.0
"""Seconds for the connections to close."""


class Endpoint(ThreadHandoff):
    """What the nodes of one event loop and network share: offers, clients, topics, connections.

    `forget` is called when the last node releases it. `threads`: other threads make calls too.
    """

    def __init__(
        self,
        network: Network,
        forget: Callable[[], object] = lambda: None,
        *,
        keepalive: Keepalive = DEFAULT,
        threads: bool = False,
        faults: RouteFaults | None = None,
    ) -> None:
        super().__init__()
        self.keepalive = keepalive
        self._has_threads = threads
        self.now = clock_of(self.loop)
        """The event loop's clock."""
        self.network = network
        self.availability = Availability(network)
        self._dialler: Dialler | None = None
        self.read_buffer = memoryview(bytearray(READ_BUFFER))
        resources.keep_freed_memory(DEFAULT_LIMITS.body)
        self.address = ""
        """The address at which it listens, "" before."""
        self.holders = 1
        """The number of nodes that use this endpoint."""
        self._chance = chance_of(self.loop)
        self.id = self._chance.randbytes(16)
        """Identifies this endpoint in handshakes: as client id, and as the server's boot id."""
        self.call_numbers = CallNumbers()
        self.counters = RequestCounters(lambda: self._chance.randbytes(16))
        self.backpressure: Backpressure
        """Set when the endpoint begins to listen, as `calls_in_flight` is: many only call."""
        self.calls_in_flight: CallsInFlight
        self.failed_lookups: dict[str, tuple[str, bool]] = {}
        """See `taskrpc.core.observer.Connections`."""
        self.refusals = LimitedLog(log)
        self.faults = faults
        """Injects faults into incoming calls; None: no faults."""
        self.meter: CallMeter | None = None
        """Measures the calls while other programs watch this one; else None."""
        self._offers = OfferTable()
        self.offers = self._offers.by_method
        """The offers by method id."""
        self._own_entry = TrackedEntry(this_process())
        """The registry entry of this process."""
        self._served: dict[ServingConnection, None] = {}
        """Connections on which this process is the server, in order of arrival."""
        self._admission: Admission | None = None
        self._ticker: asyncio.TimerHandle | None = None
        """The timer of the next check; None while there is nothing to check."""
        self._forget = forget
        self._advertising = self._closed = False
        self._accepted_traffic, self._dialled_traffic = Traffic(), Traffic()
        self._topics: Topics | None = None

    async def open(self) -> None:
        """Begin to see other programs; each node awaits it first. Raises TaskRpcError."""
        await self.network.open()

    # For nodes: nodes, services, clients, topics

    def add_node(self, name: str) -> None:
        """Announce a node."""
        self.publish(EntryChange(node=name))

    def remove_node(self, name: str) -> None:
        """Withdraw a node's announcement."""
        self.publish(EntryChange(node=name, gone=True))

    def offer(self, offer: Offer) -> None:
        """Accept calls for a service. Raises NameInUse if another process has the name."""
        self._listen()
        self._offers.add(offer)
        try:
            self.publish(EntryChange(service=_named(offer)), claim="" if offer.join else offer.name)
        except BaseException:
            self._offers.remove(offer)
            raise
        self._advertise()
        if self.network.native is not None:
            try:
                self.network.native.offer(offer)
            except BaseException:
                self.withdraw(offer)
                raise

    def withdraw(self, offer: Offer) -> None:
        """Accept no more calls for a service; earlier calls may still get responses."""
        if self._offers.remove(offer):
            if self.network.native is not None:
                self.network.native.withdraw(offer)
            self.publish(EntryChange(service=_named(offer), gone=True))
            self._advertise()

    def add_server(self, server: ServiceEndpoint) -> None:
        """Announce another server of a service of this process; it gets no calls itself."""
        self.publish(EntryChange(service=server))

    def remove_server(self, server: ServiceEndpoint) -> None:
        """Withdraw the announcement of `add_server`."""
        self.publish(EntryChange(service=server, gone=True))

    def replace(self, offer: Offer, by: Offer) -> None:
        """Pass new calls of a service to the offer `by`."""
        if self._offers.remove(offer):
            self._offers.add(by)
            if self.network.native is not None:
                self.network.native.replace(offer, by)
            self._advertise()

    def channel(
        self, name: str, srv_type: ServiceType, node: str, *, otherwise: Sequence[str] = ()
    ) -> RemoteChannel:
        """Return a node's channel to a service; to one of `otherwise` if none offers the first."""
        named = ServiceEndpoint(name, srv_type._TYPE, srv_type._HASH, node)
        if self.network.native is not None:
            self.network.native.add_type(srv_type)
        self.publish(EntryChange(client=named))
        from taskrpc.core.transport.channel import RemoteChannel  # many programs only serve

        return RemoteChannel(self, named, srv_type, otherwise=otherwise)

    def channel_closed(self, named: ServiceEndpoint) -> None:
        """Withdraw the announcement of a client."""
        self.publish(EntryChange(client=named, gone=True))

    def create_publisher(
        self, named: TopicEndpoint, msg_type: Any, role: Role, on_mismatch: Any = None
    ) -> TopicPublisher:
        """Create a publisher, and begin to listen if necessary.

        `role` is the lowest role of a subscriber. A subscription that does not match is logged, or
        reported to `on_mismatch`.
        """
        native = self.network.native
        publisher: TopicPublisher
        if native is None:
            self._listen()
            publisher = self.topics.create_publisher(named, msg_type, role, on_mismatch)
        else:
            publisher = native.create_publisher(named, msg_type, on_mismatch)
        return self._published(EntryChange(publisher=named), publisher)

    def publisher_closed(self, named: TopicEndpoint) -> None:
        """Withdraw the announcement of a publisher."""
        self.publish(EntryChange(publisher=named, gone=True))

    def create_subscription(
        self, named: TopicEndpoint, msg_type: Any, deliver: Any, on_mismatch: Any = None
    ) -> TopicSubscription:
        """Create a subscription; a publisher that does not match is logged or reported."""
        topics: Topics | NativeSide = self.network.native or self.topics
        subscription = topics.create_subscription(named, msg_type, deliver, on_mismatch)
        return self._published(EntryChange(subscription=named), subscription)

    def subscription_closed(self, named: TopicEndpoint) -> None:
        """Withdraw the announcement of a subscription."""
        self.publish(EntryChange(subscription=named, gone=True))

    def _published(self, change: EntryChange, item: _Item) -> _Item:
        """Announce a publisher or subscription; close it if that is not possible."""
        try:
            self.publish(change)
        except BaseException:
            item.close()
            raise
        return item

    @property
    def topics(self) -> Topics:
        """The publishers and subscriptions; created at the first use."""
        if self._topics is None:
            from taskrpc.core.transport.pubsub.endpoint_topics import (
                Topics,  # most programs have none
            )

            self._topics = Topics(self)
        return self._topics

    @property
    def dialler(self) -> Dialler:
        """The connections to other processes; created at the first use."""
        if self._dialler is None:
            from taskrpc.core.transport.connection import dialling  # many programs only serve

            self._dialler = dialling.Dialler(self.network, self._caller, closed=self._closed)
        return self._dialler

    # For nodes: the graph

    async def graph(self) -> list[RegistryEntry]:
        """Return the entries of all processes that this one can see and reach."""
        asked = [self._list_peer(address) for address in self.network.peers()]
        remote = await asyncio.gather(*asked)
        return self.network.entries() + [entry for entry in remote if entry is not None]

    async def definition(self, name: str) -> tuple[str, str]:
        """Return a service's type and the full text of its definition.

        Raises ServiceUnavailable if no process offers it, or the error with which asking failed.
        """
        from taskrpc.core.transport.connection.dialling import READY_TIMEOUT

        deadline = self.loop.time() + READY_TIMEOUT
        problem: TaskRpcError = no_server(self.network, name)
        for address in self.network.locate(name):
            try:
                connection = await self.dialler.connection(address, deadline)
                asked = connection.resolve(Resolve(name), deadline, definition=True)
                resolved = await asked.future
            except TaskRpcError as error:
                if not isinstance(error, ServiceUnavailable):
                    problem = error
            else:
                if not resolved.definition:
                    raise no_definition(name, resolved.type_name, address.type_hash)
                return resolved.type_name, resolved.definition
        raise problem

    async def statistics(self, timeout: float) -> list[ProgramStatistics]:
        """Return the statistics of every other process that this one can see.

        `timeout`: seconds for all of them together.
        """
        from taskrpc.core.transport.watching import read_statistics  # few programs need it

        own = self._own_entry.entry()
        entries = [each for each in self.network.entries() if each is not own]
        return await read_statistics(self.network, self.dialler, entries, timeout)

    def traffic(self) -> tuple[str, Connections, Connections]:
        """Return this endpoint's id, and the counts of accepted and of dialled connections."""
        dialled = self._dialled_traffic.counts(self._dialled())
        accepted = self._accepted_traffic.counts(self._served)
        callers = Counter(each.principal for each in list(self._served))
        accepted.accounts = {account: count for account, count in callers.items() if account}
        accepted.failed_lookups = dict(self.failed_lookups)
        return self.id.hex(), accepted, dialled

    # For nodes: shutdown

    async def release(self) -> None:
        """Release the endpoint for one node; the last node's release closes it."""
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
            if self._dialler is not None:
                await self._dialler.close()
            await self._ends(CLOSE_TIMEOUT)
            for connection in self._connections():
                connection.abort(ConnectionLost("the node was destroyed"))
            await self._ends(CLOSE_TIMEOUT)
            if self._ticker is not None:
                self._ticker.cancel()
        finally:  # a callback that destroys its own node is cancelled while it waits here
            self.network.close()

    # For the connections

    def method_of(self, name: str) -> int:
        """The method id of a service, 0 if there is none."""
        return self._offers.method_of(name)

    def listing(self) -> Listing:
        """The names in this process: nodes, services, clients and topics."""
        entry = self._own_entry.entry()
        return Listing(
            list(entry.nodes),
            list(entry.services),
            list(entry.clients),
            list(entry.publishers),
            list(entry.subscriptions),
        )

    def statistics_for(self, watcher: ServingConnection) -> Statistics:
        """Return what the meter has measured; it measures until the watchers have left."""
        if self.meter is None:
            from taskrpc.core.transport.connection.call_meter import CallMeter  # rarely needed

            self.meter = CallMeter(self.now)
        if watcher not in self.meter.watchers:
            self.meter.watchers[watcher] = None
            self._measure()
        measured = [each for each in self._served if each not in self.meter.watchers]
        calls = [call for each in measured for call in each.session.open_tickets()]
        services = [offer.name for offer in self.offers.values()]
        return self.meter.statistics(services, calls, len(measured), time.process_time())

    def _watcher_left(self, watcher: ServingConnection) -> None:
        meter = self.meter
        if (
            meter is not None
            and meter.watchers.pop(watcher, watcher) is None
            and not meter.watchers
        ):
            self.meter = None
            self._measure()

    def _measure(self) -> None:
        for connection in self._served:
            connection.measure()

    def caller_proved(self, connection: ServingConnection) -> None:
        """Count a connection as authenticated: its handshake is done."""
        if self._admission is not None:
            self._admission.proved(connection)

    def connection_began(self, connection: Connection) -> None:
        """Count a new connection, and set what it proves about the peer."""
        self._traffic_of(connection).began()
        if connection.serves:
            served = cast("ServingConnection", connection)
            self._served[served] = None
            if self._admission is not None and connection.transport is not None:
                self._admission.arrived(served, connection.transport.get_extra_info("peername"))
        else:
            self.dialler.connections[cast("CallingConnection", connection)] = None
        self._identify(connection)
        self._schedule_tick()

    def connection_ended(self, connection: Connection) -> None:
        """Forget a connection that is gone."""
        self._traffic_of(connection).left(connection)
        if connection.serves:
            served = cast("ServingConnection", connection)
            self._served.pop(served, None)
            self._watcher_left(served)
            if self._admission is not None:
                self._admission.left(served)
        else:
            self.dialler.ended(cast("CallingConnection", connection))

    # Listening and handshakes

    def _listen(self) -> None:
        """Listen, if this is the first service or publisher."""
        if not self.address:
            from taskrpc.core.transport.limits.admission import Admission
            from taskrpc.core.transport.limits.backpressure import Backpressure
            from taskrpc.core.transport.limits.calls_in_flight import CallsInFlight

            self.backpressure, self.calls_in_flight, self._admission = (
                Backpressure(),
                CallsInFlight(),
                Admission(),
            )
            self.address = self.network.listen(self._accepted)
            if self._watches_files:  # they may change before the first connection
                self._schedule_tick()

    @property
    def _watches_files(self) -> bool:
        accounts = self.network.accounts
        return bool(self.network.certificate) or (accounts is not None and accounts.can_change)

    def _traffic_of(self, connection: Connection) -> Traffic:
        return self._accepted_traffic if connection.serves else self._dialled_traffic

    def _caller(self, address: Address) -> CallingConnection:
        name = self._own_entry.first_node or self._own_entry.about.script
        me = self._identity(address.token, name)
        if address.domain is not None:
            me = msgspec.structs.replace(me, domain=address.domain)
        calling = _calling_class(threads=self._has_threads)
        return calling(self, me, self.availability.notify)

    def _accepted(self) -> ServingConnection:
        me, accounts = self._identity(self.network.token, ""), self.network.accounts
        if accounts is not None:
            if self._ticker is None:  # without connections, no tick has read the file
                accounts.refresh()
            me = msgspec.structs.replace(me, accounts=accounts.current, today=time_of_day())
        return _serving_class(threads=self._has_threads)(self, me)

    def _identity(self, token: bytes, name: str) -> Identity:
        nonce = self._chance.randbytes(16)
        return Identity(self.id, nonce, token, self.network.domain, name)

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
        """Publish a change of this process's registry entry."""
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
        """Notify callers of changed services, once in a turn of the event loop."""
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
            from taskrpc.core.transport.connection.dialling import with_address

            log.warning("%s", with_address(address.text, error))
            return None
        return entry_of(address.text, listing)

    def _dialled(self) -> Collection[Connection]:
        return self._dialler.connections if self._dialler is not None else ()

    def _connections(self) -> list[Connection]:
        return [*self._served, *self._dialled()]

    async def _ends(self, timeout: float) -> None:
        """Wait until the connections are closed: their transports need the running loop."""
        ends = [connection.gone for connection in self._connections()]
        if ends:
            await asyncio.wait(ends, timeout=timeout)

    def _tick(self) -> None:
        self._ticker = None
        connections = self._connections()
        # First: even if something below fails, the next tick must find revoked accounts.
        if connections or (self.address and self._watches_files):
            self._schedule_tick()
        if self._admission is not None:
            self.backpressure.measure_all()
            self.calls_in_flight.settle()
        self._check(connections, max(SLICE, len(connections) // SLICES))
        if (accounts := self.network.accounts) is not None:
            accounts.refresh()
            for served in list(self._served):
                served.check_account(accounts.current, time_of_day())
        if self.address and self.network.certificate != self._own_entry.about.certificate:
            self.publish(EntryChange())

    def _schedule_tick(self) -> None:
        if self._ticker is None and not self._closed:
            self._ticker = self.loop.call_later(TICK, self._tick)

    def _check(self, connections: list[Connection], count: int, begin: int = 0) -> None:
        """Check so many connections now, and the others spread over the second."""
        now, end = self.loop.time(), begin + count
        for connection in connections[begin:end]:
            connection.tick(now)
        if end < len(connections) and not self._closed:
            wait = TICK * count / len(connections)
            self.loop.call_later(wait, self._check, connections, count, end)


def _calling_class(*, threads: bool) -> type[CallingConnection]:
    if not threads:
        from taskrpc.core.transport.connection.client_side import CallingConnection

        return CallingConnection
    from taskrpc.core.transport.connection.client_threads import ThreadedConnection

    return ThreadedConnection


def _serving_class(*, threads: bool) -> type[ServingConnection]:
    if not threads:
        from taskrpc.core.transport.connection.server_side import ServingConnection

        return ServingConnection
    from taskrpc.core.transport.connection.server_threads import ThreadedServing

    return ThreadedServing


def _named(offer: Offer) -> ServiceEndpoint:
    return ServiceEndpoint(offer.name, offer.srv_type._TYPE, offer.srv_type._HASH, offer.node)
