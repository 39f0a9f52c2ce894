"""A hostile client on raw bytes: it requests work even after the server has refused it.

It follows docs/reference/wire-protocol.md and shares no code with the product. A real client
stops by itself when a handshake fails, so a server that accepts every proof would look safe. With
its own HMAC, a bug that is planted into the product is on one side only.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import hmac
import os
import ssl
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field

import msgspec

MAGIC = b"TRPC"
HELLO, HELLO_ACK, AUTH, AUTH_OK, RESOLVE, REQUEST, RESPONSE, ERROR = 1, 2, 3, 4, 6, 7, 8, 9
PING, SUBSCRIBE, PUBLISH, OPTIONAL = 11, 14, 16, 0x80
NO_DEADLINE = 0xFFFFFFFF
PATIENCE = 10.0
"""Seconds within which a server must close the connection of an unknown client."""

_HEADER = struct.Struct("<IBBHII")
_HONEST_IS_DONE = 5
"""Call id of the last request; a server that answers it has answered all."""


def frame(type_: int, body: bytes = b"", method: int = 0, call_id: int = 0, arg: int = 0) -> bytes:
    """One frame, without flags."""
    return _HEADER.pack(12 + len(body), type_, 0, method, call_id, arg) + body


def pack(*fields: object) -> bytes:
    """A body."""
    return msgspec.msgpack.encode(fields)


def questions(service: str, topic: tuple[str, str, str]) -> bytes:
    """The attacker's requests: a listing, a service, calls of it, and a topic's messages."""
    call = pack(1, 2)
    return b"".join(
        [
            frame(RESOLVE, pack("", "", ""), call_id=1),
            frame(RESOLVE, pack(service, "", ""), call_id=2),
            *[frame(REQUEST, call, method, 2 + method, NO_DEADLINE) for method in (1, 2)],
            frame(SUBSCRIBE, pack(*topic, "/evil", 10, True, True), call_id=1),
            frame(PING, arg=7),
            frame(RESOLVE, pack("", "", ""), call_id=_HONEST_IS_DONE),
        ]
    )


@dataclass
class Heard:
    """The frames that a server has sent on a connection."""

    types: set[int] = field(default_factory=set)
    """Types of the frames after HELLO_ACK, without ERROR frames that belong to no call."""
    refusals: list[str] = field(default_factory=list)
    """The messages of these errors."""
    hung: bool = False
    """Whether the connection was still open after `PATIENCE`."""

    @property
    def let_in(self) -> bool:
        """Whether the server accepted the client as authenticated."""
        return bool(self.types)


class Line:
    """One connection of the attacker."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, channel: bytes
    ) -> None:
        self._reader, self._writer = reader, writer
        self.channel = channel
        """The digest of the certificate that the server showed, empty without TLS."""
        self.nonce = os.urandom(16)
        self.their_nonce = bytes(16)

    def send(self, data: bytes) -> None:
        """Write, even if the server no longer reads."""
        self._writer.write(data)

    async def close(self) -> None:
        """Abort the connection: closing TLS may wait for a server with a planted bug."""
        self._writer.transport.abort()
        with contextlib.suppress(OSError):
            await self._writer.wait_closed()

    async def receive(self) -> tuple[int, int, bytes]:
        """The next frame: type, call id, body. Raises EOFError at the end."""
        length, type_, _, _, call_id, _ = _HEADER.unpack(await self._reader.readexactly(16))
        return type_, call_id, await self._reader.readexactly(length - 12)

    async def hello(
        self, account: str = "", *, lowest: int = 1, highest: int = 1, domain: int = 0
    ) -> None:
        """Start the handshake, and keep the server's nonce if it sends one."""
        me = pack(lowest, highest, b"E" * 16, self.nonce, domain, "/evil", account)
        self.send(MAGIC + frame(HELLO, me))
        type_, _, body = await self.receive()
        if type_ != HELLO_ACK:
            raise Refused(msgspec.msgpack.decode(body)[0])
        self.their_nonce = msgspec.msgpack.decode(body)[2]

    def proof(
        self, key: str, *, role: bytes = b"client", channel: bytes | None = None, nonce: bytes = b""
    ) -> bytes:
        """The HMAC that proves a key, or one over a changed part."""
        bound = self.channel if channel is None else channel
        said = b"taskrpc " + role + self.nonce + (nonce or self.their_nonce) + bound
        return hmac.new(key.encode(), said, hashlib.sha256).digest()

    def auth(self, proof: bytes) -> None:
        """Send a proof."""
        self.send(frame(AUTH, pack(proof)))

    async def listen(self) -> Heard:
        """Read to the end, or until the last request is answered."""
        heard = Heard()
        try:
            async with asyncio.timeout(PATIENCE):
                while True:
                    type_, call_id, body = await self.receive()
                    if type_ == ERROR and not call_id:
                        heard.refusals.append(msgspec.msgpack.decode(body)[0])
                    elif type_ != HELLO_ACK:
                        heard.types.add(type_)
                        if call_id == _HONEST_IS_DONE:
                            break
        except TimeoutError:
            heard.hung = True
        except (EOFError, OSError):
            pass
        return heard


class Refused(Exception):
    """The server refused the client before it requested a proof."""


Way = Callable[[Line], Awaitable[None]]
"""The steps of an attacker before its requests."""


@dataclass
class Attacker:
    """Attacks the server at `host:port`, or `unix:/path`."""

    place: str
    service: str = "/add"
    topic: tuple[str, str, str] = ("/secrets", "", "")
    """Its name, type and hash."""
    context: ssl.SSLContext | None = None

    @contextlib.asynccontextmanager
    async def connected(self) -> AsyncIterator[Line]:
        """A connection, which is closed with the block."""
        line = await self._open()
        try:
            yield line
        finally:
            await line.close()

    async def _open(self) -> Line:
        if self.place.startswith("unix:"):
            return Line(*await asyncio.open_unix_connection(self.place.removeprefix("unix:")), b"")
        host, _, port = self.place.rpartition(":")
        reader, writer = await asyncio.open_connection(host, int(port), ssl=self.context)
        encrypted = writer.get_extra_info("ssl_object")
        shown = b"" if encrypted is None else encrypted.getpeercert(binary_form=True)
        return Line(reader, writer, hashlib.sha256(shown).digest() if shown else b"")

    async def attempt(self, way: Way) -> Heard:
        """Take one kind of attack, then request everything, whatever the server has answered."""
        refusals: list[str] = []
        try:
            async with self.connected() as line:
                # A closed connection does not stop the attacker.
                with contextlib.suppress(EOFError, ConnectionError):
                    try:
                        await way(line)
                    except Refused as refused:
                        refusals.append(str(refused))
                line.send(questions(self.service, self.topic))
                heard = await line.listen()
        except OSError as error:  # not even connected
            return Heard(refusals=[str(error)])
        heard.refusals = refusals + heard.refusals
        return heard


def proving(account: str, make: Callable[[Line], bytes]) -> Way:
    """The usual handshake with the proof that `make` returns."""

    async def way(line: Line) -> None:
        await line.hello(account)
        line.auth(make(line))

    return way


def knowing(key: str, account: str = "") -> Way:
    """The usual handshake of a client that knows a key."""
    return proving(account, lambda line: line.proof(key))


def wrong_proofs(own: str, ana: str, revoked: str, expired: str) -> dict[str, Way]:
    """Handshakes whose proof is wrong.

    `own` is the server's token, the others are those of accounts; no attacker knows them. Proofs
    made with them are wrong here nevertheless, and a server that compares only a part accepts them.
    """

    def flipped(line: Line) -> bytes:
        right = line.proof(own)
        return right[:-1] + bytes([right[-1] ^ 1])

    other = hashlib.sha256(b"another certificate").digest()
    return {
        "zeros": proving("", lambda line: bytes(32)),
        "noise": proving("", lambda line: os.urandom(32)),
        "the first 31 bytes right": proving("", flipped),
        "the last 31 bytes right": proving("", lambda line: b"\0" + line.proof(own)[1:]),
        "the empty token": knowing(""),
        "the empty token of an account": knowing("", "ana"),
        "a guess": knowing("guess"),
        "the account's name as its secret": knowing("ana", "ana"),
        "an account's secret without its name": knowing(ana.partition(".")[2], "ana"),
        "a guess for an account": knowing("ana.guess", "ana"),
        "an account that there is not": knowing("eve.guess", "eve"),
        "one account's secret for another": knowing(ana, "bo"),
        "an account's secret for the server's": knowing(ana),
        "the server's secret for an account": knowing(own, "ana"),
        "a revoked account": knowing(revoked, "gone"),
        "an expired account": knowing(expired, "old"),
        "the server's role": proving("", lambda line: line.proof(own, role=b"server")),
        "no nonce of the server": proving("", lambda line: line.proof(own, nonce=bytes(16))),
        "another certificate": proving("", lambda line: line.proof(own, channel=other)),
        "another certificate, for an account": proving(
            "ana", lambda line: line.proof(ana, channel=other)
        ),
    }


def broken_handshakes(own: str) -> dict[str, Way]:
    """Handshakes that omit, repeat or reverse a step."""

    async def silence(line: Line) -> None:
        line.send(MAGIC)

    async def nothing(line: Line) -> None:
        pass

    async def hello_only(line: Line) -> None:
        await line.hello()

    async def proof_first(line: Line) -> None:
        line.send(MAGIC)
        line.auth(line.proof(own))

    async def second_guess(line: Line) -> None:
        await line.hello()
        line.auth(line.proof("guess"))
        line.auth(line.proof(own))

    async def second_hello(line: Line) -> None:
        await line.hello("ana")
        line.send(frame(HELLO, pack(1, 1, b"E" * 16, line.nonce, 0, "/evil", "")))
        line.auth(line.proof(own))

    async def server_frames(line: Line) -> None:
        await line.hello()
        line.send(frame(HELLO_ACK, pack(1, b"E" * 16, line.nonce, [2**24, 256, 2**26])))
        line.send(frame(AUTH_OK, pack(line.proof(own, role=b"server"))))

    async def skipped(line: Line) -> None:
        await line.hello()
        line.send(frame(OPTIONAL, b"may be skipped") * 100)

    async def short_proof(line: Line) -> None:
        await line.hello()
        line.auth(line.proof(own)[:31])

    async def no_proof(line: Line) -> None:
        await line.hello()
        line.auth(b"")

    async def old_version(line: Line) -> None:
        await line.hello(lowest=0, highest=0)
        line.auth(line.proof(own))

    async def another_domain(line: Line) -> None:
        await line.hello(domain=1)
        line.auth(line.proof(own))

    ways = [silence, nothing, hello_only, proof_first, second_guess, second_hello, server_frames]
    ways += [skipped, short_proof, no_proof, old_version, another_domain]
    return {way.__name__.replace("_", " "): way for way in ways}


def replays(attacker: Attacker, own: str) -> dict[str, Way]:
    """Handshakes that replay a right one from another, still open connection."""

    async def replay(line: Line) -> None:
        async with attacker.connected() as other:
            await other.hello()
            line.nonce = other.nonce
            other.auth(proof := other.proof(own))
            await other.receive()
            await line.hello()
            line.auth(proof)

    async def answer_sent_back(line: Line) -> None:
        async with attacker.connected() as other:
            await other.hello()
            line.nonce = other.nonce
            other.auth(other.proof(own))
            type_, _, body = await other.receive()
            await line.hello()
            if type_ == AUTH_OK:
                line.auth(msgspec.msgpack.decode(body)[0])

    async def another_nonce(line: Line) -> None:
        async with attacker.connected() as other:
            await other.hello()
            line.nonce = other.nonce
            await line.hello()
            line.auth(other.proof(own))

    return {"replay": replay, "answer sent back": answer_sent_back, "another nonce": another_nonce}
