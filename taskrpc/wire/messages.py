"""Bodies of the control frames, as typed Structs with bounded strings."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

VERSION = 1
"""The protocol version that this code speaks."""

Name = Annotated[str, Meta(max_length=512)]
Id = Annotated[bytes, Meta(min_length=16, max_length=16)]
Proof = Annotated[bytes, Meta(min_length=32, max_length=32)]


class Limits(msgspec.Struct, array_like=True, frozen=True):
    """What one side accepts from the other on one connection."""

    body: int = 16 * 1024 * 1024 + 65_536
    """Bytes of one body."""
    calls: int = 256
    """Calls in flight."""
    bytes: int = 64 * 1024 * 1024
    """Bytes of requests in flight."""


DEFAULT_LIMITS = Limits()


class Hello(msgspec.Struct, array_like=True):
    """HELLO: who calls, and in which versions it can speak."""

    lowest: int
    highest: int
    client_id: Id
    nonce: Id
    domain: int
    name: Name
    """The caller's node or program, for logs and `current_call().caller`."""


class HelloAck(msgspec.Struct, array_like=True):
    """HELLO_ACK: the version to speak, and the server's side of the bargain."""

    version: int
    boot_id: Id
    """New at each start of the server's process."""
    nonce: Id
    limits: Limits
    store_id: bytes | None = None
    """The store behind exactly-once services, where there is one."""
    knows_client: bool = False
    """Whether that store remembers this client id."""


class Auth(msgspec.Struct, array_like=True):
    """AUTH and AUTH_OK: proof that the sender knows the token."""

    proof: Proof


class Resolve(msgspec.Struct, array_like=True):
    """RESOLVE: asks for the method id of a service that the caller knows by this hash.

    An empty hash asks without claiming to know the type; an empty name asks for a `Listing`.
    """

    name: Name
    type_hash: Name = ""


class Resolved(msgspec.Struct, array_like=True):
    """The answer to RESOLVE for one service."""

    method: Annotated[int, Meta(ge=1, le=0xFFFF)]
    mode: int
    type_name: Name
    type_hash: Name
    definition: str
    """The interface's full text, for callers that have no file of it; only where asked."""


class Endpoint(msgspec.Struct, array_like=True, frozen=True):
    """One service or client that a node has."""

    name: Name
    type_name: Name
    type_hash: Name
    node: Name


class Listing(msgspec.Struct, array_like=True):
    """What a process has to offer, and who is in it."""

    nodes: list[Name]
    services: list[Endpoint]
    clients: list[Endpoint]


class ErrorBody(msgspec.Struct, array_like=True):
    """ERROR: a sentence for the caller; `path` names a wrong field."""

    message: str
    path: str = ""


encode = msgspec.msgpack.Encoder().encode
decode_hello = msgspec.msgpack.Decoder(Hello).decode
decode_hello_ack = msgspec.msgpack.Decoder(HelloAck).decode
decode_auth = msgspec.msgpack.Decoder(Auth).decode
decode_resolve = msgspec.msgpack.Decoder(Resolve).decode
decode_resolved = msgspec.msgpack.Decoder(Resolved).decode
decode_listing = msgspec.msgpack.Decoder(Listing).decode
decode_error = msgspec.msgpack.Decoder(ErrorBody).decode
