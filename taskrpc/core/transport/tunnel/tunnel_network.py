"""A `Network` over the engine of a middleware: connections made of datagrams, presence, graph."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection

import msgspec

from taskrpc.core.transport.chance import present_chance
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.engine import Engine, NativeEngine
from taskrpc.core.transport.limits.log_throttling import ThrottledLog
from taskrpc.core.transport.network import Address, Factory, missing_names
from taskrpc.core.transport.pipe import join
from taskrpc.core.transport.settings import Settings
from taskrpc.core.transport.tunnel.directory import Directory, presence_of
from taskrpc.core.transport.tunnel.native import ADDRESS as NATIVE
from taskrpc.core.transport.tunnel.native import Native
from taskrpc.core.transport.tunnel.stream_table import StreamTable
from taskrpc.errors import NameInUse, ProtocolError

log = logging.getLogger("taskrpc.transport")

PUBLIC_TOKEN = b"taskrpc: no secret"
"""The token of programs without a secret, which every program of the middleware may call."""


class TunnelNetwork:
    """The network of one program over an engine.

    Without `token` and `accounts`, every program of the engine's domain may call, natively too.
    With them, callers prove their token as over TCP, and there are no native services and topics,
    because foreign programs cannot prove anything.
    """

    certificate = ""

    def __init__(self, engine: Engine, settings: Settings) -> None:
        if missing := missing_names(engine, Engine):
            raise TypeError(f"the engine {type(engine).__name__} lacks {', '.join(missing)}")
        self.domain = settings.domain
        self.accounts = settings.account_source()
        self._given = settings.token
        """The token that the user gave."""
        is_open = settings.token is None and self.accounts is None
        self.token = PUBLIC_TOKEN if is_open else settings.token or present_chance().randbytes(32)
        self._shown_token = PUBLIC_TOKEN if is_open else b""
        """The token that other programs find in the announcement."""
        self._engine = engine
        self._native_engine = engine if isinstance(engine, NativeEngine) else None
        """The engine again, if its middleware has services and topics of its own."""
        self.native = (
            Native(self._native_engine, settings) if is_open and self._native_engine else None
        )
        self._directory = Directory()
        self._own: TrackedEntry | None = None
        """The entry of this program; None until it publishes anything."""
        self._table = StreamTable(engine.send)
        """The connections of this program."""
        self.received = self._table.received
        """Of `EngineEvents`; no method of its own, which would add a function call."""
        self._opening: asyncio.Task[None] | None = None
        self._announcing = False
        self._announced = 0
        """Counts the presences of this program."""
        self._closed = False
        self._change: asyncio.Future[None] | None = None
        """Done at the next change of the directory."""
        self._revision = 0
        """Counts the changes of the directory and of the foreign programs."""
        self.problem = ""
        """Why the middleware is interrupted, "" while it is not."""
        self._garbage_log = ThrottledLog(log)

    # Network: begin and end

    async def open(self) -> None:
        """Join the middleware, once for all nodes of the program. Raises TaskRpcError."""
        if self._opening is None:
            self._opening = asyncio.ensure_future(self._engine.open(self))
        await asyncio.shield(self._opening)

    def listen(self, factory: Factory) -> str:
        """Accept connections from now on; return this program's address."""
        self._table.accepts = factory
        return self._engine.address

    async def stop_listening(self) -> None:
        """Accept no more connections and native calls."""
        self._table.accepts = None
        if self.native is not None:
            await self.native.close()

    def close(self) -> None:
        """Leave the middleware."""
        self._closed = True
        if self._opening is not None:
            self._opening.cancel()
        self._table.end_all("the node was destroyed", tell=True)
        self._engine.close()

    uses_registry = False

    @property
    def discovery_ends(self) -> float:
        """Until when the engine may not know all programs."""
        return self._engine.discovery_ends

    # Network: connections

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect. Raises OSError."""
        if self.native is not None and address.text == NATIVE:
            return await self.native.dial(factory)
        if address.text == self._engine.address:
            return await self._connect_here(factory)
        if address.text not in self._directory:
            raise ConnectionRefusedError(f"no program is at {address.text}")
        return await self._table.dial(address.text, self._engine.address, factory)

    async def _connect_here(self, factory: Factory) -> asyncio.BaseProtocol:
        """Connect two nodes of this program, without the engine."""
        await asyncio.sleep(0)
        if self._table.accepts is None:
            raise ConnectionRefusedError("this program accepts no calls")
        client = factory()
        join(client, self._table.accepts(), self._engine.address)
        return client

    def peer_credentials(self, transport: asyncio.BaseTransport, *, serving: bool) -> None:
        """Return None: only the token proves who the peer is."""

    def channel_binding(self, transport: asyncio.BaseTransport, *, serving: bool) -> bytes:
        """Return b"": both ends know nothing that a relay between them does not know too."""
        return b""

    # Network: other programs

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Announce a change of this program's entry.

        Raises NameInUse if a known program offers the same name."""
        other = next(self._directory.serving(claim), None) if claim else None
        if other is not None:
            node = other.services[claim].node
            raise NameInUse(
                f"{claim} is already offered by the node {node} of {other.about.script}; stop that"
                " program, give this service another name, or let both serve it with join=True"
            )
        tracked.apply(change)
        self._own = tracked
        if self._native_engine is not None:
            self._native_engine.update(change)
        self._changed()
        if not self._announcing:
            self._announcing = True
            asyncio.get_running_loop().call_soon(self._announce)

    def locate(self, service: str) -> list[Address]:
        """The programs that offer a service, this one included, and then the native servers."""
        found = [
            msgspec.structs.replace(
                self._address(tracked.about.address, tracked.about.token),
                surely_offers=True,
                type_hash=tracked.services[service].type_hash,
            )
            for tracked in self._serving(service)
        ]
        if self.native is not None and (native := self.native.address_of(service)) is not None:
            found.append(native)
        return found

    def publishing(self, topics: Collection[str]) -> list[tuple[Address, Collection[str]]]:
        """Other programs that publish some of these topics, with the topics."""
        return [
            (self._address(tracked.about.address, tracked.about.token), there)
            for tracked, there in self._directory.publishing(topics)
        ]

    def entries(self) -> list[RegistryEntry]:
        """The entries of all taskrpc programs, and of the foreign nodes."""
        own = [] if self._own is None else [self._own.entry()]
        native = self._native_engine
        foreign = [] if native is None else native.foreign_entries()
        return own + self._directory.entries() + foreign

    def peers(self) -> list[Address]:
        """Return an empty list: every program announces itself."""
        return []

    def address_of(self, entry: RegistryEntry) -> Address:
        """The address of the program of an entry."""
        return self._address(entry.address, entry.token)

    def mark(self) -> object:
        """The present state of the directory, for `changed`."""
        return self._revision

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return once the directory differs from the mark."""
        while self.mark() == mark:
            if self._change is None:
                self._change = asyncio.get_running_loop().create_future()
            await asyncio.shield(self._change)

    # EngineEvents

    def program_seen(self, address: str, entry: bytes) -> None:
        """Note a program, or its new entry."""
        if address == self._engine.address or self._closed:
            return
        try:
            self._directory.seen(address, entry)
        except ProtocolError as error:
            now, text = asyncio.get_running_loop().time(), "ignored the program at %s: %s"
            self._garbage_log.warning(now, text, address, error)
        else:
            self._changed()

    def program_gone(self, address: str) -> None:
        """Forget a program, and end its connections."""
        if self._directory.gone(address):
            self._changed()
        self._table.program_gone(address)

    def foreign_changed(self) -> None:
        """Compare the calls in flight with the native servers that are left."""
        if self.native is not None and not self._closed:
            self.native.foreign_changed()
        self._changed()

    def interrupted(self, reason: str) -> None:
        """End all connections: no program can be reached."""
        log.warning("%s is interrupted: %s", self._engine.name, reason)
        self.problem = reason
        self._directory.clear()
        self._table.end_all(reason, tell=False)
        self.foreign_changed()

    def resumed(self) -> None:
        """Continue: the engine reports all programs again."""
        log.warning("%s works again", self._engine.name)
        self.problem = ""
        self._announce()
        self._changed()

    # Presence

    def _announce(self) -> None:
        self._announcing = False
        if self._own is not None and not self._closed:
            self._announced += 1
            presence = presence_of(self._own.entry(), self._shown_token, self._announced)
            self._engine.announce(presence)

    def _changed(self) -> None:
        self._revision += 1
        if self._change is not None:
            self._change.set_result(None)
            self._change = None

    def _serving(self, service: str) -> list[TrackedEntry]:
        own = self._own
        here = own is not None and own.about.address and own.offers(service)
        return ([own] if here and own is not None else []) + list(self._directory.serving(service))

    def _address(self, address: str, token: str) -> Address:
        if address == self._engine.address:
            return Address(address, self.token)
        return Address(address, bytes.fromhex(token) or self._given or b"")
