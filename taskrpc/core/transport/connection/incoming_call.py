"""A call that arrived on a connection, and the route that a method id stands for."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from srvgen import excepthook
from taskrpc.core.callinfo import CallInfo, log_fields
from taskrpc.core.request_ids.ids import IdentifiedMessage, id_splitter
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import CallNumbers, IncomingCall, Mode, Offer
from taskrpc.core.transport.codec import codec_of
from taskrpc.core.transport.connection.connection import Owner
from taskrpc.core.transport.limits.quotas import QuotaKey
from taskrpc.core.wire import messages
from taskrpc.core.wire.frames import LARGE, Body
from taskrpc.core.wire.messages import Resolved
from taskrpc.core.wire.status import code_of
from taskrpc.errors import (
    Code,
    DeadlineExceeded,
    HandlerError,
    HandlerFailed,
    InvalidRequest,
    PermissionDenied,
    ProtocolError,
    TaskRpcError,
    TypeMismatch,
)

if TYPE_CHECKING:
    from taskrpc.core.observer import Observer
    from taskrpc.core.wire.session import Session

log = logging.getLogger("taskrpc.server")


class CallNumbering(Protocol):
    """The part of a server that all its calls share."""

    call_numbers: CallNumbers
    now: Callable[[], float]
    """The event loop's clock."""


class CallConnection(Protocol):
    """What a call needs from the connection on which it arrived."""

    session: Session
    principal: str
    role: Role
    in_turn: bool

    @property
    def server(self) -> CallNumbering:
        """The process that takes the calls."""

    @property
    def owner(self) -> Owner:
        """The endpoint of the connection."""

    @property
    def flow(self) -> Hashable:
        """The caller's key in the fair queues of services."""

    @property
    def quota_key(self) -> QuotaKey:
        """The caller's key in the quotas."""

    def send_large(self, service: str, size: int) -> None:
        """Send a large response at once."""

    def flush_soon(self) -> None:
        """Write at the end of this turn of the event loop."""

    def answer_in_thread(self, call: RemoteCall, body: bytes) -> bool:
        """Answer from another thread than the event loop's; False where that is impossible."""

    def must_wait(self, call: RemoteCall) -> bool:
        """Whether the call may not begin yet."""

    def hold(self, event: RemoteCall) -> None:
        """Begin the call later."""


class RemoteCall(IncomingCall, eq=False, kw_only=True):
    """A call that arrived on a connection."""

    connection: CallConnection
    route: Route
    call_id: int

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Answer with a response message."""
        connection = self.connection
        if body is None:
            body = self.route.encode(response)
        size, session = len(body), connection.session
        if size > session.body_limit:
            raise self._too_large(size)
        spent = int((connection.server.now() - self.arrived) * 1e6 + 0.5)
        if session.respond(self.call_id, body, spent):
            if size >= LARGE:
                connection.send_large(self.service, size)
            elif not connection.in_turn:
                connection.flush_soon()

    def reply_in_thread(self, body: bytes) -> bool:
        """Answer from another thread; False where only the event loop can."""
        return self.connection.answer_in_thread(self, body)

    def fail(self, error: TaskRpcError) -> None:
        """Answer with an error."""
        if self.connection.session.fail(self.call_id, error):
            self.connection.flush_soon()

    def expired(self) -> None:
        """Cancel the call: the caller's deadline has passed."""
        self._end_early(DeadlineExceeded("no response by the deadline"))

    def cancelled_by_caller(self) -> None:
        """Cancel the call: its caller has cancelled it."""
        self._end_early(TaskRpcError("cancelled by the caller"))

    def _end_early(self, error: TaskRpcError) -> None:
        self.cancel()
        if not self.started:
            error.not_executed = True
        self.fail(error)

    def lost(self) -> None:
        """The connection is gone; a call with a request id is cancelled at its deadline only."""
        super().lost()
        if self.received_id is not None and self.deadline is not None:
            self.connection.owner.loop.call_at(self.deadline, self.cancel)

    @property
    def flow(self) -> Hashable:
        """The caller's key in fair queues; the same for all connections of one caller."""
        return self.connection.flow

    @property
    def machine(self) -> str:
        """The address of the machine that called, "" for this one."""
        return self.connection.quota_key[1]

    def must_wait(self) -> bool:
        """Whether its caller, or all callers together, have left too many responses unread."""
        return self.connection.must_wait(self)

    def postpone(self) -> None:
        """Begin the call once there is room for its response."""
        self.on_cancel = None
        self.connection.hold(self)

    def _too_large(self, size: int) -> InvalidRequest:
        limit = self.connection.session.body_limit
        return InvalidRequest("", f"a response of {size} bytes; the caller accepts {limit}")


class Route(msgspec.Struct, frozen=True, eq=False):
    """The meaning of a method id of a connection: a service, called by one node of the peer."""

    handle: int
    """The method id of the connection."""
    method: int
    """The server's number of the service."""
    offer: Offer
    caller: str
    decode: Callable[[Body], Any]
    encode: Callable[[Any], bytes]
    call: type[RemoteCall]
    """The class of calls: `ObservedCall` if the service has an observer."""
    split_id: Callable[[Body], IdentifiedMessage]
    """Splits a body into its request id and the message."""


class RouteFaults(Protocol):
    """Faults that a program injects into its calls on purpose, for tests and for teaching."""

    def applied(self, route: Route) -> Route:
        """Return a route of a connection whose calls get the faults."""


def route_to(
    offer: Offer, handle: int, method: int, caller: str, account: str, role: Role
) -> Route:
    """The route of a peer's node to a service, by the account and role of the peer."""
    request, response = codec_of(offer.srv_type.Request), codec_of(offer.srv_type.Response)
    # Checked here once for all calls of the route: an allowed call pays nothing.
    decode = request.decode if role >= offer.role else denied(offer, account, role)
    has_ids = offer.mode is Mode.EXACTLY_ONCE
    split_id = id_splitter(offer.name) if has_ids else no_request_id(offer)
    call = call_class(offer)
    return Route(handle, method, offer, caller, decode, response.encode, call, split_id)


def rerouted(route: Route, offer: Offer) -> Route:
    """The same route with another observer; calls in flight keep the former one."""
    return msgspec.structs.replace(route, offer=offer, call=call_class(offer))


def denied(offer: Offer, account: str, held: Role) -> Callable[[Body], Any]:
    """The `decode` of a route whose caller may see the service but not call it."""
    needed = offer.role.name.lower()
    sentence = (
        f"{offer.name} needs the role {needed}; the account {account} has {held.name.lower()}"
    )

    def refuse(_: Body) -> Any:
        raise PermissionDenied(sentence)

    return refuse


def no_request_id(offer: Offer) -> Callable[[Body], Any]:
    """The `split_id` of a route to a service that is not exactly-once."""

    def refuse(_: Body) -> Any:  # `lost` would not cancel a call with a request id
        raise ProtocolError(f"a request id for {offer.name}, which is not exactly-once")

    return refuse


def answer_unexpected(call: IncomingCall, error: BaseException) -> None:
    """Log a handler's exception with its traceback; the caller gets only the call number.

    The caller also gets the text of a `HandlerError.Invalid`, which says what the handler wanted.
    """
    excepthook.explain(error)
    log.error(
        "call %d of %s from %s failed:",
        call.number,
        call.service,
        call.caller,
        exc_info=error,
        extra=log_fields(call),
    )
    message = f"the handler failed; see the server's log, call {call.number}"
    if isinstance(error, HandlerError.Invalid):
        message += f": {error}"
    call.fail(HandlerFailed(Code.INTERNAL, message))


def mismatch(question: messages.Resolve, offer: Offer) -> TypeMismatch:
    """The error for a caller whose definition differs from the server's."""
    ours, theirs = offer.srv_type._HASH, question.type_hash
    return TypeMismatch(
        f"{offer.name} is offered as {offer.srv_type._TYPE} with the hash {ours[:15]}…, the caller"
        f" has another definition with the hash {theirs[:15]}…; compare the two .srv files"
    )


def call_class(offer: Offer) -> type[RemoteCall]:
    """The class for calls of a service; chosen when a caller resolves it, not for each call."""
    if offer.observer is None and not log.isEnabledFor(logging.DEBUG):
        return RemoteCall
    return ObservedCall


def resolved(
    handle: int, offer: Offer, store_id: asyncio.Future[bytes] | None, *, with_definition: bool
) -> Resolved:
    """The answer to a RESOLVE: the method id, and what the service is."""
    srv_type = offer.srv_type
    text = srv_type._DEFINITION if with_definition else ""
    name = b"" if store_id is None else store_id.result()
    return Resolved(handle, int(offer.mode), srv_type._TYPE, srv_type._HASH, text, name)


class ObservedCall(RemoteCall, eq=False, kw_only=True):
    """A call that reports its begin and its end to the observer, or to the log at DEBUG."""

    ended: bool = False
    span: bytes = b""
    repeated: bool = False

    def __post_init__(self) -> None:
        self.span = self.connection.session.open_calls[self.call_id].span
        _debug(self, "call %d of %s from %s began")
        if (observer := self.route.offer.observer) is not None:
            _notify(observer.call_began, self)

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Answer with a response message."""
        super().reply(response, body)
        if not self.ended and (observer := self.route.offer.observer) is not None:
            _notify(observer.call_answered, self, response)
        self._end(Code.OK)

    def reply_in_thread(self, body: bytes) -> bool:
        """False: observers are called on the event loop's thread."""
        return False

    def note_repetition(self) -> None:
        """Note that the request repeats an earlier one."""
        self.repeated = True

    def fail(self, error: TaskRpcError) -> None:
        """Answer with an error."""
        super().fail(error)
        code = code_of(error)
        self._end(Code.CANCELLED if code is Code.UNKNOWN and self.cancelled else code)

    def lost(self) -> None:
        """The connection is gone."""
        super().lost()
        self._end(Code.CANCELLED)

    def _end(self, code: Code) -> None:
        # A handler may still answer after its caller got DeadlineExceeded.
        if not self.ended:
            self.ended = True
            _report_end(self, self.route.offer.observer, code, self.clock() - self.arrived)


def refused(connection: CallConnection, route: Route, error: TaskRpcError) -> None:
    """Report a request to the observer that was refused before it became a call."""
    server, offer = connection.server, route.offer
    caller = route.caller, connection.principal, connection.role
    call = CallInfo(offer.name, *caller, server.call_numbers.next(), None, server.now)
    _report_end(call, offer.observer, code_of(error), 0.0)


def _report_end(call: CallInfo, observer: Observer | None, code: Code, seconds: float) -> None:
    _debug(call, "call %d of %s from %s ended: %s after %.6f s", code.name, seconds)
    if observer is not None:
        _notify(observer.call_ended, call, code, seconds)


def _notify(method: Callable[..., object], *args: Any) -> None:
    from taskrpc.core.observer import call_observer  # few services have an observer

    call_observer(method, *args)


def _debug(call: CallInfo, text: str, *more: object) -> None:
    if log.isEnabledFor(logging.DEBUG):
        log.debug(text, call.number, call.service, call.caller, *more, extra=log_fields(call))
