"""Bodies of the control frames, as typed Structs with bounded strings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from taskrpc.core.wire.frames import Body
from taskrpc.errors import ProtocolError
from taskrpc.qos import Timing

VERSION = 1
"""The protocol version that this code speaks."""

STATISTICS = "?statistics"
"""The name in a RESOLVE that asks for `Statistics`; no service can have it."""

Name = Annotated[str, Meta(max_length=512, pattern=r"^[^\x00-\x1f\x7f-\x9f]*\Z")]
"""Without control characters, because names are printed in logs and on terminals."""
Id = Annotated[bytes, Meta(min_length=16, max_length=16)]
Proof = Annotated[bytes, Meta(min_length=32, max_length=32)]
_Count = Annotated[int, Meta(ge=1, le=2**31)]
_Struct = TypeVar("_Struct")


class Limits(msgspec.Struct, array_like=True, frozen=True):
    """The limits that one side sets for the other on one connection."""

    body: _Count = 16 * 1024 * 1024 + 65_536
    """Bytes of one body."""
    calls: _Count = 256
    """Calls in flight."""
    bytes: _Count = 64 * 1024 * 1024
    """Bytes of requests in flight."""


DEFAULT_LIMITS = Limits()


class Hello(msgspec.Struct, array_like=True):
    """HELLO: the client, and the range of protocol versions that it can use."""

    lowest: int
    highest: int
    client_id: Id
    nonce: Id
    domain: int
    name: Name
    """The caller's node or program, for logs and `current_call().caller`."""
    account: Name = ""
    """The account whose token the caller is going to prove; "" for the server's own token."""


class HelloAck(msgspec.Struct, array_like=True):
    """HELLO_ACK: the chosen version, the server, and its limits."""

    version: int
    boot_id: Id
    """New at each start of the server's process."""
    nonce: Id
    limits: Limits


class Auth(msgspec.Struct, array_like=True):
    """AUTH and AUTH_OK: proof that the sender knows the token."""

    proof: Proof


class Resolve(msgspec.Struct, array_like=True):
    """RESOLVE: asks for the method id of a service with this name and type hash.

    With an empty hash, the server does not compare the types. An empty name asks for a `Listing`,
    and the name `STATISTICS` for `taskrpc.core.wire.statistics.Statistics`.
    """

    name: Name
    type_hash: Name = ""
    caller: Name = ""
    """The calling node; the returned method id identifies it in later requests."""


class Resolved(msgspec.Struct, array_like=True):
    """The response to RESOLVE for one service."""

    method: Annotated[int, Meta(ge=1, le=0xFFFF)]
    mode: int
    type_name: Name
    type_hash: Name
    definition: str
    """The interface's full text, for callers without its file; "" unless requested."""
    store_id: Annotated[bytes, Meta(max_length=16)]
    """The id of an exactly-once service's store; sequence numbers count per store. Else empty."""


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
    """Whether the durability is transient_local; otherwise it is volatile."""
    timing: Timing | None = None
    """The deadline and the liveliness; None means no limits."""


class Publishing(msgspec.Struct, array_like=True):
    """One publisher of a topic, as its process announces it to a subscription."""

    number: Annotated[int, Meta(ge=0, le=0xFFFF)]
    """The number that its messages carry."""
    publisher: TopicEndpoint
    refusal: Name = ""
    """Why the caller's role forbids its messages; "" if it does not."""
    alive: bool | None = True
    """None as long as its program must declare this and has not done so."""


class Announcement(msgspec.Struct, array_like=True):
    """The response to SUBSCRIBE, sent again after each change: the publishers of the topic."""

    publishers: list[Publishing]


class Listing(msgspec.Struct, array_like=True):
    """The nodes of a process, with their services, clients and topics."""

    nodes: list[Name]
    services: list[ServiceEndpoint]
    clients: list[ServiceEndpoint]
    publishers: list[TopicEndpoint] = []
    subscriptions: list[TopicEndpoint] = []


class ErrorBody(msgspec.Struct, array_like=True):
    """ERROR: a sentence for the caller; `path` is the invalid field, "" without one."""

    message: str
    path: str = ""


def decoder(cls: type[_Struct]) -> Callable[[Body], _Struct]:
    """Return a function that decodes a body; for an invalid body it raises only ProtocolError."""
    # Made at the first body: most programs never receive most of these messages.
    decode: Callable[[Body], _Struct] | None = None

    def decoded(body: Body) -> _Struct:
        nonlocal decode
        if decode is None:
            decode = msgspec.msgpack.Decoder(cls).decode
        try:
            return decode(body)
        # msgspec raises the last two for text that is not UTF-8, and for too deep nesting.
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise ProtocolError(f"{cls.__name__} is not valid: {error}") from None

    return decoded


encode = msgspec.msgpack.Encoder().encode

# Each raises ProtocolError for an invalid body, and no other error.
decode_hello = decoder(Hello)
decode_hello_ack = decoder(HelloAck)
decode_auth = decoder(Auth)
decode_resolve = decoder(Resolve)
decode_resolved = decoder(Resolved)
decode_listing = decoder(Listing)
decode_subscription = decoder(TopicEndpoint)
decode_announcement = decoder(Announcement)
decode_error = decoder(ErrorBody)


SPAN_SIZE = 25
"""Bytes of a span: 16 for the trace id, 8 for the span id, 1 for flags."""


def cut_span(body: Body) -> tuple[bytes, Body]:
    """Return the span and the rest of a body. Raises ProtocolError if the body is too short."""
    if len(body) < SPAN_SIZE:
        raise ProtocolError("a traced request without its span")
    return bytes(body[:SPAN_SIZE]), body[SPAN_SIZE:]
