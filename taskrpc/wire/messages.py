"""Bodies of the control frames, as typed Structs with bounded strings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from taskrpc.errors import ProtocolError
from taskrpc.wire.frames import Body

VERSION = 1
"""The protocol version that this code speaks."""

Name = Annotated[str, Meta(max_length=512, pattern=r"^[^\x00-\x1f\x7f-\x9f]*\Z")]
"""Names end up in logs and on terminals, where a peer's control characters would do harm."""
Id = Annotated[bytes, Meta(min_length=16, max_length=16)]
Proof = Annotated[bytes, Meta(min_length=32, max_length=32)]
_Count = Annotated[int, Meta(ge=1, le=2**31)]
_Struct = TypeVar("_Struct")


class Limits(msgspec.Struct, array_like=True, frozen=True):
    """What one side accepts from the other on one connection."""

    body: _Count = 16 * 1024 * 1024 + 65_536
    """Bytes of one body."""
    calls: _Count = 256
    """Calls in flight."""
    bytes: _Count = 64 * 1024 * 1024
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
    account: Name = ""
    """Whose token the caller is going to prove, "" for the server's own."""


class HelloAck(msgspec.Struct, array_like=True):
    """HELLO_ACK: the version to speak, and the server's side of the bargain."""

    version: int
    boot_id: Id
    """New at each start of the server's process."""
    nonce: Id
    limits: Limits


class Auth(msgspec.Struct, array_like=True):
    """AUTH and AUTH_OK: proof that the sender knows the token."""

    proof: Proof


class Resolve(msgspec.Struct, array_like=True):
    """RESOLVE: asks for the method id of a service that the caller knows by this hash.

    An empty hash asks without claiming to know the type; an empty name asks for a `Listing`.
    """

    name: Name
    type_hash: Name = ""
    caller: Name = ""
    """The calling node; the method id that is answered stands for it too."""


class Resolved(msgspec.Struct, array_like=True):
    """The answer to RESOLVE for one service."""

    method: Annotated[int, Meta(ge=1, le=0xFFFF)]
    mode: int
    type_name: Name
    type_hash: Name
    definition: str
    """The interface's full text, for callers that have no file of it; only where asked."""
    store_id: Annotated[bytes, Meta(max_length=16)]
    """The store of an exactly-once service, towards which requests are counted; else empty."""


class ServiceEndpoint(msgspec.Struct, array_like=True, frozen=True):
    """One service or client that a node has."""

    name: Name
    type_name: Name
    type_hash: Name
    node: Name


class TopicEndpoint(msgspec.Struct, array_like=True, frozen=True):
    """One publisher or subscription that a node has."""

    name: Name
    type_name: Name
    type_hash: Name
    node: Name
    depth: _Count
    reliable: bool
    latched: bool
    """Durability transient_local, else volatile."""


class Publishing(msgspec.Struct, array_like=True):
    """One publisher of a topic, as its process tells a subscription of it."""

    number: Annotated[int, Meta(ge=0, le=0xFFFF)]
    """What its messages carry."""
    publisher: TopicEndpoint
    refusal: Name = ""
    """Why the subscription gets nothing of it, where that is the caller's role."""


class Announcement(msgspec.Struct, array_like=True):
    """The answer to SUBSCRIBE, and again whenever it changes: who publishes the topic here."""

    publishers: list[Publishing]


class Listing(msgspec.Struct, array_like=True):
    """What a process has to offer, and who is in it."""

    nodes: list[Name]
    services: list[ServiceEndpoint]
    clients: list[ServiceEndpoint]
    publishers: list[TopicEndpoint] = []
    subscriptions: list[TopicEndpoint] = []


class ErrorBody(msgspec.Struct, array_like=True):
    """ERROR: a sentence for the caller; `path` names a wrong field."""

    message: str
    path: str = ""


def _decoder(cls: type[_Struct]) -> Callable[[Body], _Struct]:
    decode = msgspec.msgpack.Decoder(cls).decode

    def decoded(body: Body) -> _Struct:
        try:
            return decode(body)
        # msgspec lets a text that is not UTF-8 and too deep a nesting out as these.
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise ProtocolError(f"{cls.__name__} is not valid: {error}") from None

    return decoded


encode = msgspec.msgpack.Encoder().encode

# Each raises ProtocolError for a body that is not one of its Struct, and nothing else.
decode_hello = _decoder(Hello)
decode_hello_ack = _decoder(HelloAck)
decode_auth = _decoder(Auth)
decode_resolve = _decoder(Resolve)
decode_resolved = _decoder(Resolved)
decode_listing = _decoder(Listing)
decode_subscription = _decoder(TopicEndpoint)
decode_announcement = _decoder(Announcement)
decode_error = _decoder(ErrorBody)


SPAN_SIZE = 25
"""Bytes: 16 of the trace's id, 8 of the span's, 1 of flags."""


def cut_span(body: Body) -> tuple[bytes, Body]:
    """The span and the rest of a body. Raises ProtocolError where it is too short for one."""
    if len(body) < SPAN_SIZE:
        raise ProtocolError("a traced request without its span")
    return bytes(body[:SPAN_SIZE]), body[SPAN_SIZE:]
