"""Both ends of a connection, joined by a wire that the test controls."""

from __future__ import annotations

import hmac
import inspect
import textwrap
from collections.abc import Iterator
from typing import Any
from unittest import mock

from msgspec.structs import replace

from taskrpc.core.wire import messages
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import Event
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.messages import Limits
from taskrpc.core.wire.session import Session

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
        """Deliver all bytes until no end sends more; return the events of both ends."""
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
    assert pair.client.state is pair.server.state is ConnectionState.OPEN
    return pair


class Comparisons:
    """How secrets that came from outside were compared.

    How long `==` takes tells how many bytes are right, which no test over a socket can see. So
    each such secret is a `Watched`, and what looks into it by any other way is counted.
    """

    def __init__(self) -> None:
        self.received = 0
        self.in_constant_time = 0
        """Calls of `hmac.compare_digest` with one of them."""
        self.by_hand = 0
        """Uses of `==`, of a hash, or of a single byte."""

    def watch(self, monkeypatch: Any) -> Comparisons:
        """Watch the proofs of all handshakes from now on."""
        decode, compare = messages.decode_auth, hmac.compare_digest

        def decode_watched(body: bytes) -> messages.Auth:
            return messages.Auth(self.watched(decode(body).proof))

        def counting(one: Any, other: Any) -> bool:
            self.in_constant_time += Watched in (type(one), type(other))
            return compare(one, other)

        monkeypatch.setattr(messages, "decode_auth", decode_watched)
        monkeypatch.setattr(hmac, "compare_digest", counting)
        return self

    def watched(self, secret: bytes) -> Watched:
        """A secret as if it had come from outside."""
        self.received += 1
        return Watched(secret, self)


class Watched(bytes):
    """Bytes that count each look into them; as a subclass they are asked on both sides of `==`."""

    comparisons: Comparisons

    def __new__(cls, secret: bytes, comparisons: Comparisons) -> Watched:
        made = super().__new__(cls, secret)
        made.comparisons = comparisons
        return made

    def _looked_into(self) -> None:
        self.comparisons.by_hand += 1

    def __eq__(self, other: object) -> bool:
        self._looked_into()
        return bytes(self).__eq__(other)

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        self._looked_into()
        return super().__hash__()

    def __iter__(self) -> Iterator[int]:
        self._looked_into()
        return super().__iter__()

    def __getitem__(self, place: Any) -> Any:
        if isinstance(place, slice):
            return Watched(super().__getitem__(place), self.comparisons)
        self._looked_into()
        return super().__getitem__(place)

    def startswith(self, *given: Any) -> bool:
        self._looked_into()
        return super().startswith(*given)


class Replaced:
    """A function of the product with another text."""

    def __init__(self, owner: Any, name: str, text: str, by: str) -> None:
        source = textwrap.dedent(inspect.getsource(getattr(owner, name)))
        assert text in source, "the planted difference does not fit the product"
        made: dict[str, Any] = {}
        module = inspect.getmodule(owner)
        exec(source.replace(text, by), vars(module), made)
        self.patch = mock.patch.object(owner, name, made[name])
