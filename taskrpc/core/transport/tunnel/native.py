"""A middleware's own services and topics: calls to and from programs that are not taskrpc's.

A foreign program calls a service of this program: the engine passes the request to the offer.

This program calls a service of a foreign program: the client connects to a server inside this
process, which passes each call on to the engine. So the deadline, cancellation, retries and typed
errors of the client work as with any other server, as far as the middleware allows it.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
from collections import deque
from functools import partial
from typing import Any

import srvgen
from taskrpc.core.observer import call_observer
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import (
    IncomingCall,
    Offer,
)
from taskrpc.core.transport.codec import ServiceType, codec_of
from taskrpc.core.transport.connection.deadline_timer import clock_of
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.transport.engine import (
    Cancelable,
    Closable,
    ForeignServer,
    NativeEngine,
    NativeReply,
)
from taskrpc.core.transport.memory import Hub, MemoryNetwork
from taskrpc.core.transport.network import Address, Factory
from taskrpc.core.transport.settings import Settings
from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.core.wire.status import code_of
from taskrpc.errors import (
    Code,
    HandlerFailed,
    InvalidRequest,
    OutcomeUnknown,
    ServiceUnavailable,
    TaskRpcError,
)

log = logging.getLogger("taskrpc.transport")

ADDRESS = "native"
"""The address of the server inside this process; no engine has such an address."""
MOST_IN_FLIGHT = 10
"""Calls to one foreign service at a time; the others wait. A ROS 2 server queues ten requests and
drops the oldest one when more arrive."""


class Native:
    """The native side of one program."""

    def __init__(self, engine: NativeEngine, settings: Settings) -> None:
        self._engine = engine
        self._domain = settings.domain
        self._served: dict[str, tuple[_Served, Closable]] = {}
        """The services of this program that foreign programs can call, by name."""
        self._foreign: dict[str, _ForeignService] = {}
        """The foreign services that this program looked for and that exist, by name."""
        self._types: dict[str, ServiceType] = {}
        """The classes with which this program calls, by type hash."""
        self._inner: Endpoint | None = None
        """The server inside this process; None before the first foreign service is found."""
        self._inner_network: MemoryNetwork | None = None
        self._closed = False
        self._numbers = itertools.count(1)
        self.create_publisher = engine.create_publisher
        """Of `NativeSide`: topics are the engine's own."""
        self.create_subscription = engine.create_subscription

    # NativeSide: services of this program

    def offer(self, offer: Offer) -> None:
        """Serve a service natively too. Raises TaskRpcError if the middleware refuses it."""
        served = _Served(offer, self._numbers)
        type_name, type_hash = offer.srv_type._TYPE, offer.srv_type._HASH
        named = ServiceEndpoint(offer.name, type_name, type_hash, offer.node)
        closable = self._engine.serve(named, offer.srv_type, served.arrived)
        self._served[offer.name] = served, closable

    def withdraw(self, offer: Offer) -> None:
        """Stop serving it to foreign programs."""
        known = self._served.get(offer.name)
        if known is not None and known[0].offer is offer:
            del self._served[offer.name]
            known[1].close()

    def replace(self, offer: Offer, by: Offer) -> None:
        """Pass native calls of a service to the offer `by`."""
        known = self._served.get(offer.name)
        if known is not None and known[0].offer is offer:
            known[0].offer = by

    # Foreign services

    def add_type(self, srv_type: ServiceType) -> None:
        """Note a class with which this program calls; native servers may have the same type."""
        self._types[srv_type._HASH] = srv_type

    def address_of(self, service: str) -> Address | None:
        """Return the address at which this program reaches a foreign service; None without one."""
        servers = [] if self._closed else self._engine.foreign_servers(service)
        if not servers:
            self._drop(service)
            return None
        srv_type = self._type_of(servers)
        known = self._foreign.get(service)
        if known is None or known.offer.srv_type._HASH != srv_type._HASH:
            self._drop(service)
            known = self._add(service, srv_type, servers[0].node)
        network = self._inner_network
        assert network is not None, "a foreign service without the server inside"
        type_hash = srv_type._HASH
        return Address(ADDRESS, network.token, surely_offers=True, type_hash=type_hash)

    async def dial(self, factory: Factory) -> asyncio.BaseProtocol:
        """Connect a client with the server inside this process. Raises OSError."""
        if self._inner is None or self._inner_network is None:
            raise ConnectionRefusedError("no foreign service is known")
        address = Address(self._inner.address, self._inner_network.token)
        return await self._inner_network.dial(address, factory)

    def foreign_changed(self) -> None:
        """End the calls to foreign services whose server is gone."""
        for name in list(self._foreign):
            self.address_of(name)

    async def close(self) -> None:
        """End all native services and calls."""
        self._closed = True
        for _, closable in self._served.values():
            closable.close()
        self._served.clear()
        for name in list(self._foreign):
            self._drop(name, here=True)
        if self._inner is not None:
            inner, self._inner = self._inner, None
            await inner.release()

    def _type_of(self, servers: list[ForeignServer]) -> ServiceType:
        """Return the class for calls to these servers.

        It is a class of this program with the same hash. If the engine does not know the hash, the
        name of the type must be the same. Otherwise the result only names the type of the first
        server: a client with another definition then gets TypeMismatch.
        """
        for server in servers:
            for each in self._types.values():
                if _is_same(each, server):
                    return each
        with contextlib.suppress(srvgen.DefinitionError):
            found: ServiceType = srvgen.load(servers[0].type_name)
            if _is_same(found, servers[0]):
                return found
        return _UnknownType(servers[0])

    def _add(self, service: str, srv_type: ServiceType, node: str) -> _ForeignService:
        if self._inner is None:
            self._inner_network = MemoryNetwork(domain=self._domain, hub=Hub())
            self._inner = Endpoint(self._inner_network)
        known = self._foreign[service] = _ForeignService(self._engine, service, srv_type, node)
        self._inner.offer(known.offer)
        return known

    def _drop(self, service: str, *, here: bool = False) -> None:
        known = self._foreign.pop(service, None)
        if known is not None and self._inner is not None:
            self._inner.withdraw(known.offer)
            known.gone(here=here)


def _is_same(srv_type: ServiceType, server: ForeignServer) -> bool:
    if server.type_hash:
        return server.type_hash == srv_type._HASH
    return server.type_name == srv_type._TYPE


class _UnknownType:
    """The type of a foreign service of which this program has no class."""

    _DEFINITION = ""

    def __init__(self, server: ForeignServer) -> None:
        empty = srvgen.define("taskrpc/srv/Unknown", "---")  # it is refused before any call
        self.Request, self.Response = empty.Request, empty.Response
        self._TYPE = server.type_name
        self._HASH = server.type_hash


class _Served:
    """A service of this program as foreign programs call it."""

    def __init__(self, offer: Offer, numbers: itertools.count[int]) -> None:
        self.offer = offer
        self._numbers = numbers
        loop = asyncio.get_running_loop()
        self._clock = clock_of(loop)

    def arrived(self, request: Any, reply: NativeReply) -> None:
        """Pass a native request to the service."""
        offer = self.offer
        call = NativeCall(
            service=offer.name,
            caller=reply.caller,
            principal="",
            role=Role.ADMIN,
            number=next(self._numbers),
            deadline=None,
            clock=self._clock,
            request=request,
            arrived=self._clock(),
            way_back=reply,
            offer=offer,
        )
        if offer.observer is not None:
            call_observer(offer.observer.call_began, call)
        offer.serve(call)


class NativeCall(IncomingCall, eq=False, kw_only=True):
    """A call by a foreign program."""

    way_back: NativeReply
    offer: Offer
    ended: bool = False
    """Whether the response or an error was sent."""

    @property
    def is_foreign(self) -> bool:
        """True."""
        return True

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Send the response."""
        if body is None:
            codec_of(self.offer.srv_type.Response).encode(response)  # raises InvalidRequest
        if not self.ended:
            self.ended = True
            self.way_back.reply(response)
            if self.offer.observer is not None:
                call_observer(self.offer.observer.call_answered, self, response)
            self._report_end(Code.OK)

    def fail(self, error: TaskRpcError) -> None:
        """Send the error to the caller, if the middleware can carry it."""
        if not self.ended:
            self.ended = True
            self.way_back.fail(error)
            self._report_end(code_of(error))

    def _report_end(self, code: Code) -> None:
        if (observer := self.offer.observer) is not None:
            call_observer(observer.call_ended, self, code, self.clock() - self.arrived)


class _ForeignService:
    """A foreign service as the server inside this process offers it."""

    def __init__(self, engine: NativeEngine, name: str, srv_type: ServiceType, node: str) -> None:
        self.offer = Offer(name=name, srv_type=srv_type, node=node, serve=self._arrived)
        self._engine = engine
        self._waiting: deque[IncomingCall] = deque()
        self._running: dict[IncomingCall, Cancelable] = {}

    def gone(self, *, here: bool) -> None:
        """End all calls: this program ends (`here`), or the last server is gone."""
        name = self.offer.name
        running, self._running = self._running, {}
        problem = "the node was destroyed" if here else f"the server of {name} has left"
        for call, sent in running.items():
            sent.cancel()
            call.fail(OutcomeUnknown(problem))
        problem = "the node was destroyed" if here else f"no server offers {name} any more"
        while self._waiting:
            self._waiting.popleft().fail(ServiceUnavailable(problem))

    def _arrived(self, call: IncomingCall) -> None:
        call.on_cancel = partial(self._cancelled, call)
        if len(self._running) < MOST_IN_FLIGHT:
            self._begin(call)
        else:
            self._waiting.append(call)

    def _begin(self, call: IncomingCall) -> None:
        call.started = True
        name, done = self.offer.name, partial(self._done, call)
        try:
            self._running[call] = self._engine.call(name, self.offer.srv_type, call.request, done)
        except TaskRpcError as error:
            call.fail(error)

    def _done(self, call: IncomingCall, response: Any, error: BaseException | None) -> None:
        if self._running.pop(call, None) is None:
            return
        if isinstance(error, TaskRpcError):
            call.fail(error)
        elif error is not None:
            log.error("%s failed to call %s:", self._engine.name, call.service, exc_info=error)
            call.fail(OutcomeUnknown(f"{self._engine.name} failed to call {call.service}"))
        else:
            self._reply(call, response)
        self._begin_next()

    def _reply(self, call: IncomingCall, response: Any) -> None:
        try:
            call.reply(response)
        except InvalidRequest as problem:
            text = f"the foreign server's response is not valid: {problem}"
            call.fail(HandlerFailed(Code.INTERNAL, text))

    def _cancelled(self, call: IncomingCall) -> None:
        sent = self._running.pop(call, None)
        if sent is not None:
            sent.cancel()
            self._begin_next()
        elif call in self._waiting:
            self._waiting.remove(call)

    def _begin_next(self) -> None:
        while self._waiting and len(self._running) < MOST_IN_FLIGHT:
            self._begin(self._waiting.popleft())
