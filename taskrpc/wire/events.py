"""What a session reports: past-tense facts, each with what its reader needs."""

from __future__ import annotations

from typing import Any, TypeAlias

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.wire import messages
from taskrpc.wire.frames import Body
from taskrpc.wire.handshake import Peer


class Ready(msgspec.Struct, gc=False):
    """The handshake is done."""

    peer: Peer


class RequestReceived(msgspec.Struct):
    """The peer called method `method`; answer with `respond` or `fail`."""

    call_id: int
    method: int
    flags: int
    time_left: int
    """Milliseconds, `NO_DEADLINE` without a deadline."""
    body: Body
    size: int
    """Bytes of the body, which count as in flight until the answer."""
    span: bytes = b""
    """The caller's, where it told one."""
    ticket: Any = None
    """Whatever the one who answers wants to find again, as long as the call is open."""


class ResolveReceived(msgspec.Struct):
    """The peer asks for a service, or with an empty name for a listing."""

    call_id: int
    question: messages.Resolve
    with_definition: bool
    size: int
    ticket: Any = None


class LargeRequestBegan(msgspec.Struct, gc=False):
    """The peer has begun to send a large request, and will have more in flight than it has without
    asking: let it have more, or `skip_large`."""

    method: int
    size: int


class QuotaExceeded(msgspec.Struct, gc=False):
    """The peer's calls in flight are more than it has without asking; this is the last of them.

    Let it have more, or fail this one.
    """

    request: RequestReceived


class CancelReceived(msgspec.Struct, gc=False):
    """The peer gave up a call; it still awaits its terminal frame."""

    call_id: int
    request: RequestReceived | ResolveReceived
    """Its `ticket` is the call, once the request has been handled."""


class SubscribeReceived(msgspec.Struct, gc=False):
    """The peer wants a topic's messages, under this id; it wants to know who publishes it."""

    subscription_id: int
    wanted: messages.TopicEndpoint


class UnsubscribeReceived(msgspec.Struct, gc=False):
    """The peer wants no more messages under this id."""

    subscription_id: int


class LimitsExceeded(msgspec.Struct, gc=False):
    """The peer called beyond our limits: its last call was not begun, and it may call no more.

    Close the connection once the calls in flight are answered.
    """

    error: TaskRpcError


class ResponseReceived(msgspec.Struct, gc=False):
    """A call of ours got its response."""

    ticket: Any
    """What was given to `request` or `resolve`."""
    body: Body
    server_time: int
    """Microseconds in the server."""


class ErrorReceived(msgspec.Struct, gc=False):
    """A call of ours got an error."""

    ticket: Any
    error: TaskRpcError


class ServicesChanged(msgspec.Struct, gc=False):
    """The peer's services changed: what was not there may be there now."""


class PublishersReceived(msgspec.Struct, gc=False):
    """Who publishes, at the peer, the topic of a subscription of ours."""

    subscription_id: int
    publishers: list[messages.Publishing]


class MessageReceived(msgspec.Struct, gc=False):
    """A message for a subscription of ours, from the publisher that was announced so."""

    subscription_id: int
    publisher: int
    sequence: int
    """Counts the publisher's messages: a gap is a loss."""
    body: Body


class Draining(msgspec.Struct, gc=False):
    """The peer takes no new calls on this connection; `refused` are ours that it never began."""

    refused: list[Any]


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
