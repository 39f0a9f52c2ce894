"""The network inside one event loop: the same frames and rules as TCP, without sockets.

For users' tests, and for programs that no other process shall see, such as the demo. All endpoints
of one loop and domain see each other. In a simulation, each program has a loop of its own, and the
loops share their hubs: a loop with the attribute `hubs` uses these.
"""

from __future__ import annotations

import asyncio
import contextvars
import weakref
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Protocol

import msgspec

from taskrpc.core.current_program import current_program
from taskrpc.core.security.roles import account_of
from taskrpc.core.transport.chance import Chance, present_chance
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.network import Address, Factory
from taskrpc.core.transport.pipe import join
from taskrpc.core.transport.settings import Settings
from taskrpc.errors import NameInUse

if TYPE_CHECKING:
    from taskrpc.core.security.accounts import AccountSource


class Listener(msgspec.Struct, frozen=True, eq=False):
    """An endpoint that accepts connections."""

    program: str
    factory: Factory
    context: contextvars.Context
    """The context of the listening program; its side of a connection runs in it."""
    loop: asyncio.AbstractEventLoop
    """The loop of the listening program."""


class Conditions(Protocol):
    """Faults of the connections between the programs of a hub; see `taskrpc.testing`."""

    async def connect(self, caller: str, listener: Listener) -> None:
        """Return once the caller's connection reaches the listener. Raises OSError."""

    def join(
        self, client: asyncio.BufferedProtocol, caller: str, listener: Listener, name: str
    ) -> None:
        """Connect the client to a new protocol object of the listener."""


class Hub:
    """The registry that the endpoints of one loop and domain share.

    `chance`: where its token comes from, by default that of the running loop.
    """

    def __init__(self, chance: Chance | None = None) -> None:
        self.token = (chance or present_chance()).randbytes(32)
        self.entries: dict[MemoryNetwork, TrackedEntry] = {}
        self.listeners: dict[str, Listener] = {}
        """The listeners by address."""
        self.conditions: Conditions | None = None
        """The faults to inject; None for a perfect network."""
        self.revision = 0
        """Counts the changes of the entries."""
        self.names = 0
        """Counts the addresses that were given."""
        self._next: list[asyncio.Future[None]] = []

    def changed(self) -> None:
        """Wake all tasks that wait for a change."""
        self.revision += 1
        waiting, self._next = self._next, []
        for each in waiting:
            if not each.done():
                each.set_result(None)

    async def next_change(self) -> None:
        """Return at the next change."""
        change = asyncio.get_running_loop().create_future()
        self._next.append(change)
        await change


_hubs: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, dict[int, Hub]] = (
    weakref.WeakKeyDictionary()
)


def hub_of(domain: int) -> Hub:
    """Return the hub of the running loop and a domain."""
    loop = asyncio.get_running_loop()
    shared: dict[int, Hub] | None = getattr(loop, "hubs", None)
    hubs = _hubs.setdefault(loop, {}) if shared is None else shared
    try:
        return hubs[domain]  # a simulation's dictionary makes it
    except KeyError:
        hub = hubs[domain] = Hub()
        return hub


class MemoryNetwork:
    """The `Network` of one endpoint in a hub, by default that of the running loop and the domain.

    `program` names the endpoint in tests.
    """

    certificate = ""
    native = None
    problem = ""
    discovery_ends = 0.0
    uses_registry = False

    def __init__(
        self,
        *,
        domain: int,
        program: str = "",
        token: bytes | None = None,
        accounts: AccountSource | None = None,
        hub: Hub | None = None,
    ) -> None:
        self.domain = domain
        self.program = program
        self.accounts = accounts
        self._hub = hub or hub_of(domain)
        self.token = token or self._hub.token
        # With the token of an account, calls are made as this account; else with the hub's tokens.
        self._account_token = token if account_of(token or b"") else None
        self._address = ""

    async def open(self) -> None:
        """Do nothing: the hub is there."""

    def listen(self, factory: Factory) -> str:
        """Accept connections from now on; return the address."""
        self._hub.names += 1
        self._address = f"memory:{self._hub.names}"
        loop = asyncio.get_running_loop()
        listener = Listener(self.program, factory, contextvars.copy_context(), loop)
        self._hub.listeners[self._address] = listener
        return self._address

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect. Raises OSError."""
        await asyncio.sleep(0)
        listener, conditions = self._listener(address), self._hub.conditions
        if conditions is None:
            client = factory()
            join(client, listener.factory(), address.text, context=listener.context)
        else:
            await conditions.connect(self.program, listener)
            client = factory()
            conditions.join(client, self.program, self._listener(address), address.text)
        return client

    def peer_credentials(self, transport: asyncio.BaseTransport, *, serving: bool) -> None:
        """Return None: only the token proves who the peer is."""

    def channel_binding(self, transport: asyncio.BaseTransport, *, serving: bool) -> bytes:
        """Return b"": nothing can relay a connection in memory."""
        return b""

    def _listener(self, address: Address) -> Listener:
        listener = self._hub.listeners.get(address.text)
        if listener is None:
            raise ConnectionRefusedError(f"no server listens at {address.text}")
        return listener

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Publish a change of this endpoint's entry. Raises NameInUse for a `claim` of another."""
        for network, other in self._hub.entries.items():
            if claim and network is not self and other.offers(claim):
                raise NameInUse(f"{claim} is already offered by another node of this program")
        tracked.apply(change)
        self._hub.entries[self] = tracked
        self._hub.changed()

    def locate(self, service: str) -> list[Address]:
        """The endpoints that offer a service."""
        return [
            Address(
                tracked.about.address,
                self._token_for(network),
                surely_offers=True,
                type_hash=tracked.services[service].type_hash,
            )
            for network, tracked in self._hub.entries.items()
            if tracked.about.address and tracked.offers(service)
        ]

    def publishing(self, topics: Collection[str]) -> list[tuple[Address, Collection[str]]]:
        """The other endpoints that publish some of these topics, with the topics."""
        found: list[tuple[Address, Collection[str]]] = []
        for network, tracked in self._hub.entries.items():
            there = [topic for topic in topics if tracked.publishes(topic)]
            if there and network is not self and tracked.about.address:
                found.append((Address(tracked.about.address, self._token_for(network)), there))
        return found

    def _token_for(self, network: MemoryNetwork) -> bytes:
        own = self._account_token
        return network.token if own is None or network.accounts is None else own

    def entries(self) -> list[RegistryEntry]:
        """The entries of all endpoints of this loop."""
        return [tracked.entry() for tracked in self._hub.entries.values()]

    def peers(self) -> list[Address]:
        """Return an empty list: all endpoints are in the hub."""
        return []

    def address_of(self, entry: RegistryEntry) -> Address:
        """The address of an endpoint of this loop."""
        for network, tracked in self._hub.entries.items():
            if tracked.about.address == entry.address:
                return Address(entry.address, self._token_for(network))
        return Address(entry.address, bytes.fromhex(entry.token))

    def mark(self) -> object:
        """The present state of the hub, for `changed`."""
        return self._hub.revision

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return once the hub differs from the mark."""
        while self._hub.revision == mark:
            await self._hub.next_change()

    async def stop_listening(self) -> None:
        """Accept no more connections."""
        self._hub.listeners.pop(self._address, None)

    def close(self) -> None:
        """Leave the hub."""
        self._hub.entries.pop(self, None)
        self._hub.changed()


def open_network(settings: Settings) -> MemoryNetwork:
    """Return the network of a program with these settings; `listen` is the program's name."""
    return MemoryNetwork(
        domain=settings.domain,
        program=settings.listen or current_program.get(),
        token=settings.token,
        accounts=settings.account_source(),
    )
