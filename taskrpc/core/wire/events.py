"""The events that a session reports to the connection that owns it."""

from __future__ import annotations

from typing import Any, TypeAlias

import msgspec

from taskrpc.core.wire import messages
from taskrpc.core.wire.frames import Body
from taskrpc.core.wire.handshake import Peer
from taskrpc.errors import TaskRpcError


class Ready(msgspec.Struct, gc=False):
    """The handshake is done."""

    peer: Peer


class RequestReceived(msgspec.Struct):
    """The peer called a method; end the call with `respond` or `fail`."""

    call_id: int
    method: int
    flags: int
    """The bits of `Flag`."""
    time_left: int
    """Milliseconds until the deadline, `NO_DEADLINE` without one."""
    body: Body
    size: int
    """Bytes of the body, which count as in flight until the call ends."""
    span: bytes = b""
    """The caller's trace span, b"" without one."""
    ticket: Any = None
    """Any object of the server's side, kept while the call is open."""


class ResolveReceived(msgspec.Struct):
    """The peer asks for a service, or for a listing with an empty name."""

    call_id: int
    question: messages.Resolve
    with_definition: bool
    size: int
    ticket: Any = None


class LargeRequestBegan(msgspec.Struct, gc=False):
    """The peer has begun to send a large request that exceeds its quota.

    Raise the quota with `set_quota`, or call `skip_large`.
    """

    method: int
    size: int


class QuotaExceeded(msgspec.Struct, gc=False):
    """The peer's calls in flight exceed its quota; this is the newest of them.

    Raise the quota with `set_quota`, or fail this call.
    """

    request: RequestReceived


class CancelReceived(msgspec.Struct, gc=False):
    """The peer cancelled a call; it still expects a response or an error."""

    call_id: int
    request: RequestReceived | ResolveReceived
    """Its `ticket` is the call, once the request has been handled."""


class SubscribeReceived(msgspec.Struct, gc=False):
    """The peer subscribes to a topic under this id, and expects a list of its publishers."""

    subscription_id: int
    wanted: messages.TopicEndpoint


class UnsubscribeReceived(msgspec.Struct, gc=False):
    """The peer ends the subscription with this id."""

    subscription_id: int


class LimitsExceeded(msgspec.Struct, gc=False):
    """The peer exceeded our limits: its last call did not begin, and it may make no more calls.

    Close the connection once the calls in flight have ended.
    """

    error: TaskRpcError


class ResponseReceived(msgspec.Struct, gc=False):
    """A call of this end got its response."""

    ticket: Any
    """The object that was given to `request` or `resolve`."""
    body: Body
    server_time: int
    """Microseconds that the call spent in the server."""


class ErrorReceived(msgspec.Struct, gc=False):
    """A call of this end got an error."""

    ticket: Any
    error: TaskRpcError


class ServicesChanged(msgspec.Struct, gc=False):
    """The peer's services changed; a missing service may exist now."""


class PublishersReceived(msgspec.Struct, gc=False):
    """The peer's publishers for the topic of a subscription of this end."""

    subscription_id: int
    publishers: list[messages.Publishing]


class MessageReceived(msgspec.Struct, gc=False):
    """A message for a subscription of this end; `publisher` is the number that was announced."""

    subscription_id: int
    publisher: int
    sequence: int
    """Counts the publisher's messages; a gap means that messages were lost."""
    body: Body


class Draining(msgspec.Struct, gc=False):
    """The peer accepts no new calls on this connection; it never began those in `refused`."""

    refused: list[Any]
    """The tickets of these calls."""


class Closed(msgspec.Struct):
    """The connection must end: the peer broke the protocol, or refused us."""

    error: TaskRpcError


Event: TypeAlias = (
    Ready
    | RequestReceived
    | ResolveReceived
    | LargeRequestBegan
    | QuotaExceeded
    | CancelReceived
    | SubscribeReceived
    | UnsubscribeReceived
    | LimitsExceeded
    | ResponseReceived
    | ErrorReceived
    | ServicesChanged
    | PublishersReceived
    | MessageReceived
    | Draining
    | Closed
)
