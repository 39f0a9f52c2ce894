"""The answering end of a connection: requests become calls of offered services."""

from __future__ import annotations

import asyncio
import logging
import traceback
from collections import deque
from typing import Any, Protocol

from taskrpc.errors import (
    Code,
    DeadlineExceeded,
    HandlerFailed,
    InvalidRequest,
    ServerBusy,
    ServiceUnavailable,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.transport.base import IncomingCall, Offer
from taskrpc.transport.codec import codec_of
from taskrpc.transport.connection import Connection, Owner
from taskrpc.wire import messages
from taskrpc.wire.events import CancelReceived, Event, Ready, RequestReceived, ResolveReceived
from taskrpc.wire.frames import LARGE, NO_DEADLINE
from taskrpc.wire.handshake import Identity
from taskrpc.wire.messages import Listing, Resolved
from taskrpc.wire.session import State

log = logging.getLogger("taskrpc.server")

MAX_HANDLES = 0xFFFF
"""Services, counted for each calling node, that one connection can use."""
LINGER = 0.5
"""Seconds in which a caller may close a drained connection itself. Closing first, with a request
of its still unread, would reset the connection and could destroy our last words."""


class Host(Owner, Protocol):
    """What a process offers, as far as its connections ask."""

    def next_call_number(self) -> int:
        """Counts calls, for logs."""

    def offer_of(self, method: int) -> Offer | None:
        """The service behind a method id."""

    def method_of(self, name: str) -> int:
        """The method id of a service, 0 if there is none."""

    def listing(self) -> Listing:
        """Everything that this process offers."""


class ServedCall(IncomingCall):
    """A call that came over a connection."""

    __slots__ = ("_arrived", "_connection", "_slot", "call_id", "offer")

    def __init__(
        self,
        connection: ServingConnection,
        offer: Offer,
        call_id: int,
        arrived: float,
        deadline: float | None,
        caller: str,
    ) -> None:
        host = connection.host
        self._arrived = arrived
        super().__init__(offer.name, caller, host.next_call_number(), deadline, host.loop.time)
        self._connection = connection
        self.offer = offer
        self.call_id = call_id
        self.on_cancel = None
        self.started = False
        self._slot = host.deadlines.add(deadline, self) if deadline is not None else 0

    def reply(self, response: Any) -> None:
        """Answer with a response message."""
        body = codec_of(self.offer.srv_type.Response).encode(response)
        limit = self._connection.session.body_limit
        if len(body) > limit:
            raise InvalidRequest("", f"a response of {len(body)} bytes; the caller accepts {limit}")
        if self._ended():
            spent = self._connection.host.loop.time() - self._arrived
            self._connection.session.respond(self.call_id, body, round(spent * 1e6))
            # Large answers are not collected: the caller that does not read them must be noticed.
            self._connection.flush_soon() if len(body) < LARGE else self._connection.flush()

    def fail(self, error: TaskRpcError) -> None:
        """Answer with an error."""
        if self._ended():
            self._connection.session.fail(self.call_id, error)
            self._connection.flush_soon()

    def expired(self) -> None:
        """The caller's deadline passed."""
        self.cancel()
        unstarted = None if self.started else True
        self.fail(DeadlineExceeded("no answer by the deadline", not_executed=unstarted))

    def _ended(self) -> bool:
        if self.deadline is not None:
            self._connection.host.deadlines.discard(self._slot, self)
        return self._connection.calls.pop(self.call_id, None) is not None


class ServingConnection(Connection):
    """A connection on which we are called."""

    def __init__(self, host: Host, me: Identity) -> None:
        super().__init__(host, me, is_client=False)
        self.host = host
        self.caller = ""
        self.calls: dict[int, ServedCall] = {}
        self._draining = False
        self._linger: asyncio.TimerHandle | None = None
        self._writing_paused = False
        self._held: deque[ServedCall] = deque()
        # Several nodes of a program share a connection: a method id means a service and a caller.
        self._handles: dict[tuple[int, str], int] = {}
        self._meanings: dict[int, tuple[int, str]] = {}

    def pause_writing(self) -> None:
        """The caller reads slower than we answer: begin no more calls of it for now."""
        self._writing_paused = True
        if self.transport is not None and not self.transport.is_closing():
            self.transport.pause_reading()

    def resume_writing(self) -> None:
        """The caller has caught up."""
        self._writing_paused = False
        if self.transport is not None and not self.transport.is_closing():
            self.transport.resume_reading()
        while self._held and not self._writing_paused:
            call = self._held.popleft()
            if call.call_id in self.calls:
                call.offer.serve(call)

    def happened(self, event: Event) -> None:
        """Serve a request."""
        match event:
            case RequestReceived():
                self._serve(event)
            case ResolveReceived():
                self._resolve(event)
            case CancelReceived():
                self._cancel(event.call_id)
            case Ready():
                self.handshake_over()
                self.caller = event.peer.name

    def ended(self) -> None:
        """The caller is gone: what still runs for it is cancelled."""
        if self._linger is not None:
            self._linger.cancel()
        self.session.lost()
        for call in list(self.calls.values()):
            call.cancel()
            call.fail(TaskRpcError("the caller is gone"))

    def drain(self) -> None:
        """Take no new calls; close once those in flight are answered."""
        self._draining = True
        self.session.drain()
        self.flush()

    def flush(self) -> None:
        """Write what the session has to say; a drained connection closes after its last answer."""
        super().flush()
        if self._draining and self._linger is None and not self.session.serving:
            in_talk = self.session.state is State.DRAINING
            self._linger = self.owner.loop.call_later(LINGER if in_talk else 0.0, self.close)

    def _serve(self, event: RequestReceived) -> None:
        method, caller = self._meanings.get(event.method, (0, ""))
        offer = self.host.offer_of(method)
        if offer is None:
            gone = ServiceUnavailable("the service is no longer offered here")
            self.session.fail(event.call_id, gone)
            return
        now = self.host.loop.time()
        deadline = None if event.time_left == NO_DEADLINE else now + event.time_left / 1000
        try:
            request = codec_of(offer.srv_type.Request).decode(event.body)
        except InvalidRequest as error:
            self.session.fail(event.call_id, error)
            return
        call = ServedCall(self, offer, event.call_id, now, deadline, caller)
        call.request = request
        self.calls[event.call_id] = call
        if self._writing_paused:
            self._held.append(call)
        else:
            offer.serve(call)

    def _cancel(self, call_id: int) -> None:
        call = self.calls.get(call_id)
        if call is not None:
            call.cancel()
            call.fail(TaskRpcError("cancelled by the caller"))

    def _resolve(self, event: ResolveReceived) -> None:
        question = event.question
        if not question.name:
            self.session.respond(event.call_id, messages.encode(self.host.listing()))
            return
        method = self.host.method_of(question.name)
        offer = self.host.offer_of(method)
        if offer is None:
            error: TaskRpcError = ServiceUnavailable(f"no service {question.name} here")
            self.session.fail(event.call_id, error)
        elif question.type_hash not in ("", offer.srv_type._HASH):
            self.session.fail(event.call_id, mismatch(question, offer))
        elif len(self._handles) >= MAX_HANDLES:
            # Numbers are never given twice on one connection; the next one begins anew.
            error = ServerBusy(f"{MAX_HANDLES} services were asked for on this connection")
            self.session.fail(event.call_id, error)
            self.drain()
        else:
            handle = self._handle(method, question.caller or self.caller)
            body = _resolved(handle, offer, with_definition=event.with_definition)
            self.session.respond(event.call_id, messages.encode(body))

    def _handle(self, method: int, caller: str) -> int:
        """The number by which this peer calls a service for one of its nodes."""
        meaning = method, caller
        handle = self._handles.setdefault(meaning, len(self._handles) + 1)
        self._meanings[handle] = meaning
        return handle


def mismatch(question: messages.Resolve, offer: Offer) -> TypeMismatch:
    """What a caller learns whose definition is not the server's."""
    ours, theirs = offer.srv_type._HASH, question.type_hash
    return TypeMismatch(
        f"{offer.name} is offered as {offer.srv_type._TYPE} with the hash {ours[:15]}…, the caller"
        f" has another definition with the hash {theirs[:15]}…; compare the two .srv files"
    )


def answer_unexpected(call: IncomingCall, error: BaseException) -> None:
    """Log a callback's exception with its traceback; tell the caller only where to look."""
    text = "".join(traceback.format_exception(error)).rstrip()
    log.error("call %d of %s from %s failed:\n%s", call.number, call.service, call.caller, text)
    message = f"the handler failed; see the server's log, call {call.number}"
    call.fail(HandlerFailed(Code.INTERNAL, message))


def _resolved(handle: int, offer: Offer, *, with_definition: bool) -> Resolved:
    srv_type = offer.srv_type
    text = srv_type._DEFINITION if with_definition else ""
    return Resolved(handle, int(offer.mode), srv_type._TYPE, srv_type._HASH, text)
