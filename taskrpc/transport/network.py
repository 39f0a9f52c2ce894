"""What differs between TCP and memory: who is where, how to reach them, how to be reached."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Protocol

import msgspec

from taskrpc.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.wire.handshake import PeerCredentials

if TYPE_CHECKING:
    from taskrpc.security.accounts import AccountSource


class Address(msgspec.Struct, frozen=True):
    """Where a process takes calls, and the token that it wants to see."""

    place: str
    """`host:port`, or the name of an endpoint in memory."""
    token: bytes
    surely_offers: bool = False
    """Whether a directory says that the wanted service is there (a bare peer must be asked)."""
    type_hash: str = ""
    """Of the definition that a directory says the service has there, "" where nobody says."""
    certificate: str | None = None
    """The one that a directory says is shown there (PEM), "" for none; None where nobody says."""
    domain: int | None = None
    """The one that it is in where that is another than ours."""
    pid: int = 0
    """The process id, if the registry of this machine knows it, else 0."""
    script: str = ""
    """The script of that process."""

    def __repr__(self) -> str:
        return f"Address({self.place!r})"  # without the token: what is printed ends in logs


Factory = Callable[[], asyncio.BufferedProtocol]


class Network(Protocol):
    """The part of an endpoint that knows sockets, or does without."""

    token: bytes
    """What callers of this process must prove to know."""
    domain: int
    accounts: AccountSource | None
    """Who may call beside those who know the token; None where there are no accounts."""

    @property
    def certificate(self) -> str:
        """What callers of this process are shown now (PEM), "" for plain connections."""

    def listen(self, factory: Factory) -> str:
        """Take connections from now on; returns the place. Raises CannotListen."""

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect. Raises OSError."""

    def peer_credentials(
        self, transport: asyncio.BaseTransport, *, serving: bool
    ) -> PeerCredentials | None:
        """What a connection proves of the other side by itself.

        `serving` says that we are called on it. Raises PermissionDenied for one that may not stay.
        """

    def channel_binding(self, transport: asyncio.BaseTransport, *, serving: bool) -> bytes:
        """What both ends know of a connection, and nobody between them can have the same of two."""

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Tell everybody of a change to what this process has; the tracked takes note of it.

        Raises NameInUse, and nothing has changed, if another process offers the service `claim`.
        """

    def locate(self, service: str) -> list[Address]:
        """Whom to ask for a service, the surest first."""

    def publishing(self, topics: Collection[str]) -> list[tuple[Address, Collection[str]]]:
        """Which other processes publish any of these topics, or must be asked, and which."""

    def entries(self) -> list[RegistryEntry]:
        """What the directory knows of every process, this one included."""

    def peers(self) -> list[Address]:
        """Processes that are in no directory and must be asked themselves."""

    def mark(self) -> object:
        """What the directory looks like now."""

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return when the directory looks different from the mark."""

    async def stop_listening(self) -> None:
        """Take no more connections."""

    def close(self) -> None:
        """Leave no trace."""
