"""The network of the checks' node: registry and sockets of a sandbox, through its supervisor."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Callable, Collection, Iterator
from contextvars import ContextVar
from typing import Protocol

from taskrpc.errors import NameInUse, TaskRpcError
from taskrpc.spi import (
    TRANSPORTS,
    Address,
    EntryChange,
    Factory,
    Listener,
    Registration,
    RegistryEntry,
    Settings,
    TrackedEntry,
    is_loopback,
    join_address,
    split_address,
)

TRANSPORT = "sandbox"
"""The name of the transport: `Node("check", transport=TRANSPORT)`."""


class SandboxCheck(Protocol):
    """What a check has in its sandbox; see `box.Check`."""

    listening: socket.socket
    """A socket that listens on the loopback of the sandbox."""
    entries: list[RegistryEntry]
    """The entries of the programs in the sandbox's registry."""
    revision: int
    """Counts the changes of `entries`."""

    async def new_socket(self) -> socket.socket:
        """Return a socket that can connect within the sandbox. Raises TaskRpcError."""

    async def next_change(self) -> None:
        """Return at the next change of `entries`."""

    def publish(self, entry: RegistryEntry, change: EntryChange) -> None:
        """Publish a change of the checks' entry."""


_check: ContextVar[SandboxCheck] = ContextVar("the check whose sandbox a new node uses")


class SandboxNetwork:
    """The network of a node outside of a sandbox that calls and serves the programs in it.

    It opens no file of the sandbox. Its sockets can only reach the loopback of the sandbox.
    """

    certificate = ""
    native = None
    problem = ""
    discovery_ends = 0.0
    uses_registry = False
    accounts = None

    def __init__(self, check: SandboxCheck, domain: int) -> None:
        self.domain = domain
        self.token = os.urandom(32)
        self._check = check
        self._own: TrackedEntry | None = None
        self._listener: Listener | None = None

    async def open(self) -> None:
        """Do nothing: the sandbox is there."""

    def listen(self, factory: Factory) -> str:
        """Accept connections from now on; return the address."""
        listening = self._check.listening.dup()
        listening.setblocking(False)
        self._listener = Listener(listening, factory)
        return join_address(*listening.getsockname()[:2])

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect. Raises OSError."""
        loop = asyncio.get_running_loop()
        try:
            host, port = split_address(address.text)
            if not is_loopback(host):
                raise ConnectionRefusedError(f"{address.text} is not in the sandbox")
            sock = await self._check.new_socket()
        except TaskRpcError as error:
            raise ConnectionRefusedError(str(error)) from None
        try:
            await loop.sock_connect(sock, (host, port))
            _, protocol = await loop.create_connection(factory, sock=sock)
        except BaseException:
            sock.close()
            raise
        return protocol

    def peer_credentials(self, transport: asyncio.BaseTransport, *, serving: bool) -> None:
        """Return None: only the token proves who the peer is."""

    def channel_binding(self, transport: asyncio.BaseTransport, *, serving: bool) -> bytes:
        """Return b"": the connection is not encrypted."""
        return b""

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Publish a change of the checks' entry. Raises NameInUse for a `claim` of a program."""
        if claim and any(other.offers(claim) for other in self._others()):
            raise NameInUse(f"{claim} is already offered by a program of the submission")
        self._check.publish(tracked.about, change)
        tracked.apply(change)
        self._own = tracked

    def locate(self, service: str) -> list[Address]:
        """The programs to ask for a service."""
        found = [*([] if self._own is None else [self._own]), *self._others()]
        return [
            Address(
                tracked.about.address,
                _token(tracked.about),
                surely_offers=True,
                type_hash=tracked.services[service].type_hash,
                certificate="",
                pid=tracked.about.pid,
                script=tracked.about.script,
            )
            for tracked in found
            if tracked.about.address and tracked.offers(service)
        ]

    def publishing(self, topics: Collection[str]) -> list[tuple[Address, Collection[str]]]:
        """The programs that publish some of these topics, with the topics."""
        found: list[tuple[Address, Collection[str]]] = []
        for tracked in self._others():
            there = [topic for topic in topics if tracked.publishes(topic)]
            if there and tracked.about.address:
                found.append((self.address_of(tracked.about), there))
        return found

    def entries(self) -> list[RegistryEntry]:
        """The entries of all programs, and of the checks."""
        own = [] if self._own is None else [self._own.entry()]
        return own + self._check.entries

    def peers(self) -> list[Address]:
        """Return an empty list: all programs are in the registry."""
        return []

    def address_of(self, entry: RegistryEntry) -> Address:
        """The address of the program of an entry."""
        return Address(
            entry.address, _token(entry), certificate="", pid=entry.pid, script=entry.script
        )

    def mark(self) -> object:
        """The present state of the registry, for `changed`."""
        return self._check.revision

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return once the registry differs from the mark."""
        while self._check.revision == mark:
            await self._check.next_change()

    async def stop_listening(self) -> None:
        """Accept no more connections."""
        if self._listener is not None:
            listener, self._listener = self._listener, None
            with contextlib.suppress(OSError):
                self._check.listening.shutdown(socket.SHUT_RDWR)
            await listener.close()

    def close(self) -> None:
        """Do nothing: the registry ends with the check."""

    def _others(self) -> Iterator[TrackedEntry]:
        return (TrackedEntry(entry) for entry in self._check.entries)


@contextlib.contextmanager
def network_of(check: SandboxCheck) -> Iterator[None]:
    """Let new nodes with this transport use the sandbox of a check."""
    opener = "taskrpc.course.labs.sandbox.network:open_network"
    TRANSPORTS[TRANSPORT] = Registration(opener)
    token = _check.set(check)
    try:
        yield
    finally:
        _check.reset(token)
        del TRANSPORTS[TRANSPORT]


def open_network(settings: Settings) -> SandboxNetwork:
    """Return a network of the check of `network_of`."""
    return SandboxNetwork(_check.get(), settings.domain)


def _token(entry: RegistryEntry) -> bytes:
    try:
        return bytes.fromhex(entry.token)
    except ValueError:  # a program can write anything
        return b""
