"""The interface that each transport implements: find programs, connect to them, and listen.

A transport that connects byte streams, such as TCP, implements `Network` itself. A middleware
implements `taskrpc.core.transport.engine.Engine`, and `tunnel` implements `Network` over it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Protocol

import msgspec

import srvgen
from taskrpc.core.transport.base import NativeTopics, Offer
from taskrpc.core.transport.codec import ServiceType
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.wire.handshake import PeerCredentials
from taskrpc.errors import ServiceUnavailable, TaskRpcError, TypeMismatch

if TYPE_CHECKING:
    from taskrpc.core.security.accounts import AccountSource


class Address(msgspec.Struct, frozen=True):
    """Where a process accepts calls, and how to prove identity there."""

    text: str
    """`host:port`, `unix:/path`, or the name of an endpoint in memory."""
    token: bytes
    """The secret that the caller must prove to know."""
    surely_offers: bool = False
    """Whether the registry says that the process offers the service; peers must be asked."""
    type_hash: str = ""
    """The type hash of the service, if the registry knows it, else ""."""
    certificate: str | None = None
    """The server's certificate (PEM), "" for a plain connection; None if it is unknown."""
    domain: int | None = None
    """The domain of the process, if it differs from this one's."""
    pid: int = 0
    """The process id, if the registry of this machine knows it, else 0."""
    script: str = ""
    """The script of that process."""

    def __repr__(self) -> str:
        return f"Address({self.text!r})"  # without the token: it must not appear in logs


Factory = Callable[[], asyncio.BufferedProtocol]


class NativeSide(NativeTopics, Protocol):
    """A middleware's own services and topics, which programs without taskrpc use too."""

    def offer(self, offer: Offer) -> None:
        """Serve a service natively too. Raises TaskRpcError if the middleware refuses it."""

    def withdraw(self, offer: Offer) -> None:
        """Serve it no more."""

    def replace(self, offer: Offer, by: Offer) -> None:
        """Pass native calls of a service to the offer `by`."""

    def add_type(self, srv_type: ServiceType) -> None:
        """Note a class with which this program calls; native servers may have the same type."""


class Network(Protocol):
    """The part of an endpoint that finds processes and connects to them."""

    token: bytes
    """The secret that callers of this process must prove to know."""
    domain: int
    accounts: AccountSource | None
    """The accounts that may call, besides callers with the token; None without accounts."""

    @property
    def uses_registry(self) -> bool:
        """Whether it finds programs in the registry of this machine."""

    @property
    def problem(self) -> str:
        """Why no program can be reached at present, "" if nothing is known to be wrong."""

    async def open(self) -> None:
        """Begin to see other programs. May be called again. Raises TaskRpcError."""

    @property
    def discovery_ends(self) -> float:
        """Until when programs that run already may be unknown (loop's clock), 0 if never."""

    @property
    def native(self) -> NativeSide | None:
        """The middleware's own services and topics; None without a middleware."""

    @property
    def certificate(self) -> str:
        """The current certificate of this process (PEM), "" for plain connections."""

    def listen(self, factory: Factory) -> str:
        """Accept connections from now on; return the address. Raises CannotListen."""

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect. Raises OSError."""

    def peer_credentials(
        self, transport: asyncio.BaseTransport, *, serving: bool
    ) -> PeerCredentials | None:
        """What a connection itself proves about the peer, before the handshake.

        `serving`: the peer is the caller. Raises PermissionDenied if the peer may not connect.
        """

    def channel_binding(self, transport: asyncio.BaseTransport, *, serving: bool) -> bytes:
        """A value that both ends of a connection know; with a relay between them it differs."""

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Publish a change of this process's entry, and apply it to `tracked`.

        Raises NameInUse, and changes nothing, if another process offers the service `claim`.
        """

    def locate(self, service: str) -> list[Address]:
        """The processes to ask for a service, the most certain first."""

    def publishing(self, topics: Collection[str]) -> list[tuple[Address, Collection[str]]]:
        """Other processes that publish some of these topics, or must be asked; with the topics."""

    def entries(self) -> list[RegistryEntry]:
        """The known entries of all processes, this one included."""

    def peers(self) -> list[Address]:
        """Processes that are not in the registry and must be asked directly."""

    def address_of(self, entry: RegistryEntry) -> Address:
        """The address of the process of an entry that `entries` returned."""

    def mark(self) -> object:
        """The present state of the registry, for `changed`."""

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return once the registry differs from the mark; look more often if `polls_fast()`."""

    async def stop_listening(self) -> None:
        """Accept no more connections."""

    def close(self) -> None:
        """Remove the entry of this process."""


def missing_names(candidate: object, protocol: type) -> list[str]:
    """Return the attributes and methods of a protocol that an object of another package lacks."""
    names = {*vars(protocol), *protocol.__annotations__}
    return sorted(each for each in names - {*dir(candidate)} if not each.startswith("_"))


def no_server(network: Network, service: str) -> ServiceUnavailable:
    """Return the error for a service that no known program offers."""
    problem = f": {network.problem}" if network.problem else ""
    searched = service if network.uses_registry else ""
    return ServiceUnavailable(f"no server offers {service}{problem}", service=searched)


def no_definition(service: str, type_name: str, type_hash: str) -> TaskRpcError:
    """Return the error for a service whose server does not send its definition.

    `type_hash` is the server's. This machine has no definition, or one with another hash.
    """
    try:
        here = srvgen.type_hash(type_name)
    except srvgen.DefinitionError:
        return TaskRpcError(
            f"{service} has the type {type_name}; its server does not send the definition, so put"
            " the .srv file where taskrpc finds it"
        )
    return TypeMismatch(
        f"{service} is offered as {type_name} with the hash {type_hash[:15]}…, the definition on"
        f" this machine has the hash {here[:15]}…; compare the two .srv files"
    )
