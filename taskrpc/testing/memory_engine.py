"""An engine inside one event loop: a middleware without any other software, for tests.

It is also the smallest complete example of an engine. All engines of one loop and domain share a
`Bus`. An engine that announces nothing is a foreign program: use `serve`, `call` and the topics of
such an engine to play a program that is not taskrpc's.
"""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Callable, Collection, Iterable
from typing import Any

from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import (
    Deliver,
    OnDone,
    OnMismatch,
    TopicPublisher,
    TopicSubscription,
)
from taskrpc.core.transport.codec import ServiceType, codec_of
from taskrpc.core.transport.discovery.availability import Availability
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.engine import Closable, EngineEvents, ForeignServer, NativeReply
from taskrpc.core.transport.pubsub.endpoint_topics import Topics
from taskrpc.core.transport.settings import Settings
from taskrpc.core.transport.tunnel.tunnel_network import TunnelNetwork
from taskrpc.core.wire.frames import Body
from taskrpc.core.wire.messages import ServiceEndpoint, TopicEndpoint
from taskrpc.errors import OutcomeUnknown, ServiceUnavailable, TaskRpcError


class Bus:
    """What the engines of one loop and domain share."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self.engines: dict[str, MemoryEngine] = {}
        """The open engines by address."""
        self.opened = 0
        """Counts the addresses that were given."""
        self.faults: Callable[[str, bytes], Iterable[bytes]] | None = None
        """Takes the address and each datagram, and returns the datagrams that arrive instead."""
        self.topics = Topics(_NoOtherProcess())

    def deliver(self, address: str, datagram: bytes) -> None:
        """Pass a datagram to the engine at an address, if there is one."""
        arriving = [datagram] if self.faults is None else self.faults(address, datagram)
        for each in arriving:
            if (engine := self.engines.get(address)) is not None:
                engine.events.received(each)

    def others(self, engine: MemoryEngine) -> list[MemoryEngine]:
        """All other engines."""
        return [each for each in self.engines.values() if each is not engine]

    def servers(self, service: str) -> list[NativeServer]:
        """The native servers of a service."""
        return [
            each
            for engine in self.engines.values()
            for each in engine.servers
            if each.named.name == service
        ]


_buses: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, dict[int, Bus]] = (
    weakref.WeakKeyDictionary()
)


def bus_of(domain: int) -> Bus:
    """Return the bus of the running loop and a domain."""
    buses = _buses.setdefault(asyncio.get_running_loop(), {})
    bus = buses.get(domain)
    if bus is None:
        bus = buses[domain] = Bus(domain)
    return bus


def open_network(settings: Settings) -> TunnelNetwork:
    """Return the network of a program over a memory engine."""
    return TunnelNetwork(MemoryEngine(settings.domain), settings)


class MemoryEngine:
    """One program's access to a bus."""

    name = "the memory engine"
    discovery_ends = 0.0

    def __init__(self, domain: int) -> None:
        self.address = ""
        self.events: EngineEvents = _Ignored()
        self.announced: bytes | None = None
        """What this program has announced; None for a foreign program."""
        self.servers: list[NativeServer] = []
        """The native services that this program offers."""
        self.entry = TrackedEntry(RegistryEntry(pid=0, script="memory", folder="", since=0.0))
        """The nodes, services and clients of this program in the bus's own graph."""
        self._bus = bus_of(domain)
        self._loop = asyncio.get_running_loop()

    # Presence and datagrams

    async def open(self, events: EngineEvents) -> None:
        """Join the bus."""
        self._bus.opened += 1
        self.address = f"memory engine {self._bus.domain}:{self._bus.opened}"
        self.events = events
        self._bus.engines[self.address] = self
        await asyncio.sleep(0)
        for each in self._bus.others(self):
            if each.announced is not None:
                events.program_seen(each.address, each.announced)

    def send(self, address: str, datagram: bytes) -> None:
        """Send a datagram; it arrives in a later turn of the loop."""
        self._loop.call_soon(self._bus.deliver, address, datagram)

    def announce(self, entry: bytes) -> None:
        """Show this program to the others."""
        self.announced = entry
        for each in self._bus.others(self):
            self._loop.call_soon(each.program_seen, self.address, entry)

    def program_seen(self, address: str, entry: bytes) -> None:
        """Report another program, unless it has left meanwhile."""
        if address in self._bus.engines:
            self.events.program_seen(address, entry)

    def close(self) -> None:
        """Leave the bus."""
        if self._bus.engines.pop(self.address, None) is None:
            return
        self.events = _Ignored()
        for server in list(self.servers):
            server.close()
        for each in self._bus.others(self):
            if self.announced is None:
                self._loop.call_soon(lambda other: other.events.foreign_changed(), each)
            else:
                self._loop.call_soon(lambda other: other.events.program_gone(self.address), each)

    # The graph

    def update(self, change: EntryChange) -> None:
        """Show a node, service or client of this program."""
        self.entry.apply(change)
        self._report_foreign()

    def foreign_entries(self) -> list[RegistryEntry]:
        """Return the entries of the foreign programs."""
        return [each.entry.entry() for each in self._foreign()]

    def foreign_servers(self, service: str) -> list[ForeignServer]:
        """Return the native servers of a service in foreign programs."""
        return [
            ForeignServer(each.named.type_name, each.named.type_hash, each.named.node)
            for each in self._bus.servers(service)
            if each.engine.announced is None and each.engine is not self
        ]

    def _foreign(self) -> list[MemoryEngine]:
        return [each for each in self._bus.others(self) if each.announced is None]

    def _report_foreign(self) -> None:
        if self.announced is None:
            for each in self._bus.others(self):
                self._loop.call_soon(lambda other: other.events.foreign_changed(), each)

    # Native services

    def serve(
        self,
        named: ServiceEndpoint,
        srv_type: ServiceType,
        serve: Callable[[Any, NativeReply], None],
    ) -> Closable:
        """Offer a service to the other programs of the bus."""
        server = NativeServer(self, named, srv_type, serve)
        self.servers.append(server)
        self.update(EntryChange(service=named))
        return server

    def server_closed(self, server: NativeServer) -> None:
        """Withdraw a service."""
        self.servers.remove(server)
        self.update(EntryChange(service=server.named, gone=True))

    def call(
        self, service: str, srv_type: ServiceType, request: Any, on_done: OnDone
    ) -> NativeCalling:
        """Call a native service; the first server of the same type responds."""
        body = codec_of(srv_type.Request).encode(request)
        calling = NativeCalling(srv_type, on_done, self.entry.first_node)
        same = [
            each for each in self._bus.servers(service) if each.srv_type._HASH == srv_type._HASH
        ]
        if same:
            self._loop.call_soon(same[0].requested, body, calling)
        else:
            calling.fail(ServiceUnavailable(f"no native server offers {service}"))
        return calling

    # Native topics

    def create_publisher(
        self, named: TopicEndpoint, msg_type: Any, on_mismatch: OnMismatch | None
    ) -> TopicPublisher:
        """Create a publisher on the bus."""
        return self._bus.topics.create_publisher(named, msg_type, Role.OBSERVE, on_mismatch)

    def create_subscription(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None,
    ) -> TopicSubscription:
        """Create a subscription on the bus."""
        inbox = _Inbox(deliver)
        return self._bus.topics.create_subscription(named, msg_type, inbox.arrived, on_mismatch)


class NativeServer:
    """A native service on a bus."""

    def __init__(
        self,
        engine: MemoryEngine,
        named: ServiceEndpoint,
        srv_type: ServiceType,
        serve: Callable[[Any, NativeReply], None],
    ) -> None:
        self.engine = engine
        self.named = named
        self.srv_type = srv_type
        self._serve = serve
        self._calls: dict[NativeCalling, None] = {}
        self._is_closed = False

    def requested(self, body: bytes, calling: NativeCalling) -> None:
        """Pass a request to the service."""
        if self._is_closed:
            calling.fail(OutcomeUnknown(f"the server of {self.named.name} has left"))
        elif not calling.is_over:
            self._calls[calling] = None
            calling.on_over = lambda: self._calls.pop(calling, None)
            self._serve(codec_of(self.srv_type.Request).decode(body), calling)

    def close(self) -> None:
        """Withdraw the service; calls without a response fail."""
        if not self._is_closed:
            self._is_closed = True
            self.engine.server_closed(self)
            for calling in list(self._calls):
                calling.fail(OutcomeUnknown(f"the server of {self.named.name} has left"))


class NativeCalling:
    """A native call: both the caller's end and the server's way back."""

    def __init__(self, srv_type: ServiceType, on_done: OnDone, caller: str) -> None:
        self.caller = caller
        self.is_over = False
        self.on_over: Callable[[], object] = lambda: None
        self._codec = codec_of(srv_type.Response)
        self._on_done = on_done
        self._loop = asyncio.get_running_loop()

    def reply(self, response: Any) -> None:
        """Send the response message."""
        copy = self._codec.decode(self._codec.encode(response))
        self._end(copy, None)

    def fail(self, error: TaskRpcError) -> None:
        """Send an error."""
        self._end(None, error)

    def cancel(self) -> None:
        """Forget the call."""
        self.is_over = True
        self.on_over()

    def _end(self, response: Any, error: TaskRpcError | None) -> None:
        if not self.is_over:
            self.is_over = True
            self.on_over()
            self._loop.call_soon(self._on_done, response, error)


class _Inbox:
    """The messages for one subscription; those of one turn of the loop count as one read."""

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._waiting: list[Body] = []
        self._reads = 0
        self._loop = asyncio.get_running_loop()

    def arrived(self, body: Body, _: int) -> None:
        """Deliver a message in a later turn of the loop."""
        if not self._waiting:
            self._loop.call_soon(self._read)
        self._waiting.append(body)

    def _read(self) -> None:
        waiting, self._waiting = self._waiting, []
        self._reads += 1
        for body in waiting:
            self._deliver(body, self._reads)


class _Ignored:
    """The events of an engine that is closed, or that plays a foreign program."""

    def received(self, datagram: bytes) -> None: ...
    def program_seen(self, address: str, entry: bytes) -> None: ...
    def program_gone(self, address: str) -> None: ...
    def foreign_changed(self) -> None: ...
    def interrupted(self, reason: str) -> None: ...
    def resumed(self) -> None: ...


class _NoOtherProcess:
    """The context of the bus's topics: all publishers and subscriptions are on the bus."""

    id = b""
    address = ""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.network: Any = self
        self.dialler: Any = None
        self.availability = Availability(self)

    def publishing(self, topics: Collection[str]) -> list[Any]:
        return []

    def mark(self) -> object:
        return None

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        await self.loop.create_future()
