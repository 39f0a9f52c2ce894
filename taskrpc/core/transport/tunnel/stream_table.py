"""The tunnelled connections of one program: accepts and dials them, passes datagrams to them."""

from __future__ import annotations

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Callable
from typing import cast

from taskrpc.core.transport.chance import present_chance
from taskrpc.core.transport.limits.log_throttling import ThrottledLog
from taskrpc.core.transport.network import Factory
from taskrpc.core.transport.tunnel import frames
from taskrpc.core.transport.tunnel.frames import Datagram, Kind
from taskrpc.core.transport.tunnel.stream import WINDOW, Stream
from taskrpc.core.transport.tunnel.stream_transport import StreamTransport

log = logging.getLogger("taskrpc.transport")

FORGOTTEN = 1024
"""Ended connections that are remembered, so that late datagrams get a RST."""


class StreamTable:
    """The connections of a program; `send(address, datagram)` is the engine's."""

    def __init__(self, send: Callable[[str, bytes], None]) -> None:
        self.accepts: Factory | None = None
        """Makes the protocol of an accepted connection; None while no connection is accepted."""
        self.streams: dict[int, StreamTransport] = {}
        """The connections by the id that this program has chosen."""
        self.accepted: dict[tuple[str, int], int] = {}
        """The id of each accepted connection, by the caller's address and id."""
        self.dialling: dict[int, tuple[str, Factory, asyncio.Future[asyncio.BaseProtocol]]] = {}
        """The connections that wait for an ACK: the server's address, and what follows."""
        self.forgotten: OrderedDict[int, tuple[str, int]] = OrderedDict()
        """The address and peer id of connections that ended recently."""
        self._send = send
        self._loop = asyncio.get_running_loop()
        self._garbage_log = ThrottledLog(log)

    async def dial(self, address: str, own_address: str, factory: Factory) -> asyncio.BaseProtocol:
        """Connect to the program at an address. Raises OSError; the caller limits the time."""
        own_id = self._new_id()
        connected: asyncio.Future[asyncio.BaseProtocol] = self._loop.create_future()
        self.dialling[own_id] = address, factory, connected
        self._send(address, frames.pack_syn(own_id, own_address, WINDOW))
        try:
            return await connected
        finally:
            del self.dialling[own_id]

    def received(self, datagram: bytes) -> None:
        """Pass a datagram to its connection; SYN makes a new one. Garbage is ignored."""
        parsed = frames.parse(datagram)
        if parsed is None:
            text = "ignored a datagram that is not taskrpc's"
            self._garbage_log.warning(self._loop.time(), text)
            return
        transport = self.streams.get(parsed[1])
        if transport is None:
            self._received_without_stream(parsed)
            return
        try:
            transport.feed(parsed)
        except Exception as error:  # an engine passes datagrams of other connections next
            context = {"message": "a tunnelled connection failed", "exception": error}
            self._loop.call_exception_handler(context)
            transport.abort()

    def program_gone(self, address: str) -> None:
        """End the connections with a program that has left."""
        for transport in list(self.streams.values()):
            if transport.address == address:
                transport.vanish()
        self._refuse_dialled(f"the program at {address} has left", address)

    def end_all(self, reason: str, *, tell: bool) -> None:
        """End all connections at once; with `tell`, send the other ends a RST."""
        for transport in list(self.streams.values()):
            if tell:
                transport.abort()
            else:
                transport.vanish()
        self._refuse_dialled(reason)

    def _received_without_stream(self, datagram: Datagram) -> None:
        kind, to, _, limit, data = datagram
        if kind == Kind.SYN:
            self._accept(data, limit)
        elif to in self.dialling:
            self._dialled(datagram)
        elif kind == Kind.DATA and to in self.forgotten:
            # The peer has missed the end of the connection.
            address, peer = self.forgotten[to]
            self._send(address, frames.pack_reset(peer, "the connection has ended"))

    def _accept(self, data: memoryview, limit: int) -> None:
        caller = frames.parse_syn(data)
        if caller is None:
            return
        peer, address = caller
        if (known := self.accepted.get((address, peer))) is not None:
            self._send(address, frames.pack_ack(peer, known, WINDOW))
        elif self.accepts is None:
            self._send(address, frames.pack_reset(peer, "the program accepts no calls"))
        else:
            own_id = self._new_id()
            self.accepted[address, peer] = own_id
            self._send(address, frames.pack_ack(peer, own_id, WINDOW))
            self._join(self.accepts(), address, own_id, Stream(peer, limit))

    def _dialled(self, datagram: Datagram) -> None:
        kind, to, _, limit, data = datagram
        address, factory, connected = self.dialling[to]
        if connected.done():
            return
        if kind == Kind.RST:
            connected.set_exception(ConnectionRefusedError(frames.parse_reset(data)))
        elif kind == Kind.ACK and (peer := frames.parse_ack(data)) is not None:
            protocol = factory()
            self._join(protocol, address, to, Stream(peer, limit))
            connected.set_result(cast("asyncio.BaseProtocol", protocol))

    def _join(
        self, protocol: asyncio.BufferedProtocol, address: str, own_id: int, stream: Stream
    ) -> None:
        def ended(_: StreamTransport) -> None:
            del self.streams[own_id]
            self.accepted.pop((address, stream.peer), None)
            self.forgotten[own_id] = address, stream.peer
            if len(self.forgotten) > FORGOTTEN:
                self.forgotten.popitem(last=False)

        transport = StreamTransport(protocol, address, stream, self._send, ended)
        self.streams[own_id] = transport
        protocol.connection_made(transport)

    def _new_id(self) -> int:
        # Random, so that no program can guess the ids of another program's connections.
        while True:
            found = int.from_bytes(present_chance().randbytes(8), "little")
            if found and found not in self.streams and found not in self.dialling:
                return found

    def _refuse_dialled(self, reason: str, address: str = "") -> None:
        for there, _, connected in self.dialling.values():
            if address in ("", there) and not connected.done():
                connected.set_exception(ConnectionRefusedError(reason))
