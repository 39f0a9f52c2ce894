"""Both ends of a connection, joined by a wire that the test controls."""

from __future__ import annotations

from msgspec.structs import replace

from taskrpc.wire.events import Event
from taskrpc.wire.handshake import Identity
from taskrpc.wire.link import State
from taskrpc.wire.messages import Limits
from taskrpc.wire.session import Session

TOKEN = b"the token of this server" + bytes(8)
CLIENT = Identity(b"C" * 16, b"c" * 16, TOKEN, name="/caller")
SERVER = Identity(b"S" * 16, b"s" * 16, TOKEN)


class ConnectionPair:
    """A client and a server; what one says lies on the wire until `deliver` carries it over."""

    def __init__(
        self,
        client: Identity = CLIENT,
        server: Identity = SERVER,
        *,
        limits: Limits | None = None,
    ) -> None:
        if limits is not None:
            server = replace(server, limits=limits)
        self.client = Session(client, is_client=True)
        self.server = Session(server, is_client=False)
        self.wire: dict[Session, bytearray] = {self.client: bytearray(), self.server: bytearray()}
        """What is on its way to each end."""

    def other(self, end: Session) -> Session:
        return self.server if end is self.client else self.client

    def collect(self) -> None:
        """Put what both ends have to say on the wire."""
        for end, wire in self.wire.items():
            wire += b"".join(self.other(end).take())

    def deliver(
        self, end: Session, count: int | None = None, *, piece: int = 65_536
    ) -> list[Event]:
        """Carry `count` bytes to an end (all without), in pieces; returns what happened there."""
        self.collect()
        wire = self.wire[end]
        data = bytes(wire[:count])
        del wire[: len(data)]
        return receive(end, data, piece)

    def run(self, *, piece: int = 65_536) -> tuple[list[Event], list[Event]]:
        """Carry everything to and fro until nobody says anything; the client's events first."""
        at_client: list[Event] = []
        at_server: list[Event] = []
        self.collect()
        while any(self.wire.values()):
            at_server += self.deliver(self.server, piece=piece)
            at_client += self.deliver(self.client, piece=piece)
            self.collect()
        return at_client, at_server


def receive(end: Session, data: bytes, piece: int = 65_536) -> list[Event]:
    """Give bytes to a session as a transport does: large bodies straight into their room."""
    events: list[Event] = []
    while data:
        large = end.splitter.large
        room = None if large is None else large.room()
        count = min(piece, len(data)) if room is None else min(piece, len(data), len(room))
        if room is None:
            events += end.feed(data[:count])
        else:
            room[:count] = data[:count]
            events += end.filled(count)
        data = data[count:]
    return events


def open_pair(*, limits: Limits | None = None) -> ConnectionPair:
    """A pair whose handshake is done."""
    pair = ConnectionPair(limits=limits)
    pair.run()
    assert pair.client.state is pair.server.state is State.OPEN
    return pair
