"""The server side of a connection: requests become calls of offered services."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Hashable, Iterable
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeAlias, cast

from taskrpc.core.request_ids.ids import ReceivedId
from taskrpc.core.security.roles import Account, Accounts, Role
from taskrpc.core.transport.base import CallNumbers, Offer
from taskrpc.core.transport.connection.connection import BATCH, UNREAD_LIMIT, Connection, Owner
from taskrpc.core.transport.connection.incoming_call import (
    RemoteCall,
    Route,
    RouteFaults,
    refused,
    resolved,
)
from taskrpc.core.transport.connection.plain_serving import answer_of
from taskrpc.core.transport.connection.routes import Refusal, Routes, read_request
from taskrpc.core.transport.limits.backpressure import Backpressure
from taskrpc.core.transport.limits.calls_in_flight import FREE, CallsInFlight
from taskrpc.core.transport.limits.quotas import QuotaKey, quota_key_of
from taskrpc.core.wire import messages
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import (
    CancelReceived,
    Closed,
    LargeRequestBegan,
    LimitsExceeded,
    QuotaExceeded,
    Ready,
    RequestReceived,
    ResolveReceived,
    SubscribeReceived,
    UnsubscribeReceived,
)
from taskrpc.core.wire.frames import NO_DEADLINE
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.messages import STATISTICS, Listing
from taskrpc.core.wire.session import Answer
from taskrpc.errors import (
    AuthenticationFailed,
    InvalidRequest,
    PermissionDenied,
    ProtocolError,
    ServiceUnavailable,
    TaskRpcError,
)

if TYPE_CHECKING:
    from taskrpc.core.transport.connection.call_meter import CallMeter
    from taskrpc.core.wire.statistics import Statistics

log = logging.getLogger("taskrpc.server")
_accounts_log = logging.getLogger("taskrpc.transport")

FRAMES_A_TURN = 64
"""Frames of one connection that are handled before those of other connections."""
LINGER = 0.5
"""Seconds in which a caller may close a drained connection itself. If we closed first while
a request is unread, TCP would reset the connection, and our last frames could be lost."""
_GRACE = 2 * LINGER
"""Seconds after which a connection without a valid account is aborted, even if the caller has not
read the reason."""


# One of each for all idle connections; nothing changes them.
_NO_ROUTES = Routes()
_NO_ANSWERS: dict[int, Answer] = {}

_Held: TypeAlias = "RemoteCall | ResolveReceived"


class SubscriberEvents(Protocol):
    """The topics that a caller has subscribed to, as its connection sees them."""

    def subscribe(self, event: SubscribeReceived) -> None:
        """Add a subscription."""

    def unsubscribe(self, number: int) -> None:
        """Remove a subscription."""

    def caught_up(self) -> None:
        """Send messages that waited: the caller reads again."""

    def role_changed(self) -> None:
        """Stop the topics that the caller's new role may not see."""

    def left(self) -> None:
        """Remove all subscriptions: the connection is gone."""


class PublishedTopics(Protocol):
    """The topics of a process, as far as its connections need them."""

    def subscriber_of(self, connection: ServingConnection) -> SubscriberEvents:
        """The subscriptions of a connection's caller."""


class ServerContext(Owner, Protocol):
    """What a process offers, as far as its connections need it."""

    call_numbers: CallNumbers
    """Counts calls, for logs."""
    offers: dict[int, Offer]
    """The services by their method ids."""
    backpressure: Backpressure
    """Limits the responses that callers have not read."""
    calls_in_flight: CallsInFlight
    """Limits the calls in flight, by caller."""
    failed_lookups: dict[str, tuple[str, bool]]
    """See `taskrpc.core.observer.Connections`."""

    @property
    def topics(self) -> PublishedTopics:
        """The topics that are published here."""

    def method_of(self, name: str) -> int:
        """The method id of a service, 0 if there is none."""

    def listing(self) -> Listing:
        """Everything that this process offers."""

    meter: CallMeter | None
    """Measures the calls while other programs watch; else None."""
    faults: RouteFaults | None
    """Injects faults into the calls; None in almost all programs."""

    def statistics_for(self, watcher: ServingConnection) -> Statistics:
        """Return what the meter has measured; it measures until the watchers have left."""

    def caller_proved(self, connection: ServingConnection) -> None:
        """Count a connection whose caller has proved its identity."""


class ServingConnection(Connection):
    """A connection on which the peer calls services of this process."""

    __slots__ = (
        "_held",
        "_linger",
        "account",
        "answers",
        "backpressure",
        "caller",
        "clock_at",
        "flow",
        "host_name",
        "principal",
        "quota_key",
        "role",
        "routes",
        "server",
        "subscriber",
        "writing_paused",
    )

    def __init__(self, host: ServerContext, me: Identity) -> None:
        super().__init__(host, me, is_client=False, frames_a_turn=FRAMES_A_TURN)
        self.server = host
        self.backpressure = host.backpressure
        self.host_name = ""
        """The caller's machine, "" for this one; known once it is connected."""
        self.caller = ""
        """The name of the caller's program; a route names the node."""
        self.quota_key: QuotaKey = ("", "")
        """The caller's key in the quotas for connections and memory."""
        self.flow: Hashable = b""
        """The caller's key in fair queues; each program of this machine has its own."""
        self.account: Account | None = None
        self.principal = ""
        """The name of `account`, "" for the server's own token."""
        self.role = Role.ADMIN
        self._linger: asyncio.TimerHandle | None = None
        """Closes the drained or refused connection."""
        self.writing_paused = False
        """Whether the caller reads more slowly than we write."""
        self.subscriber: SubscriberEvents | None = None
        """The caller's subscriptions; None before the first."""
        self.session.set_quota(min(FREE.calls, me.limits.calls), min(FREE.bytes, me.limits.bytes))
        # Created when first needed: of thousands of idle connections, most need no list.
        self._held: list[_Held] | None = None
        """Requests that may not begin yet; see `hold`."""
        self.routes = _NO_ROUTES
        self.answers: dict[int, Answer] = _NO_ANSWERS
        """The functions that take the calls, by the method id of the connection."""
        self.clock_at = 0.0
        """The latest reading of the clock since the last read."""

    def buffer_updated(self, nbytes: int) -> None:
        """Handle bytes that asyncio has read: run callbacks, and write their responses."""
        self._watch.received += nbytes
        self.clock_at = self.owner.now()
        if nbytes:
            self.read_at = self.clock_at
        session, self.in_turn = self.session, True
        try:
            if self._splitter.large is None:
                data = self._read_buffer[:nbytes].tobytes()
                rest, left = session.serve(data, nbytes, self.answers, BATCH)
                if rest or self._splitter.behind:
                    self._serve_rest(rest, left)
            else:
                self.handle(session.filled(nbytes))
        finally:  # responses are sent even if a callback ends the program
            self.in_turn = False
            if session.out or self._draining:
                self.flush()
            if self._splitter.behind:
                self.read_on()

    def _serve_rest(self, rest: bytes, left: int) -> None:
        """Handle the rest of a read; `left` is how many requests more the batch may have."""
        done = BATCH - left
        while rest and not left and done < FRAMES_A_TURN:
            self.flush()
            rest, left = self.session.serve(rest, len(rest), self.answers, BATCH)
            done += BATCH - left
        if rest or self._splitter.behind:
            self.handle(self.session.feed(rest, done))

    def flush_soon(self) -> None:
        """Write at the end of this turn of the event loop, or at once if no call is in flight."""
        if not self.session.open_calls and not self.in_turn and not self._flush_planned:
            self.flush()
        else:
            super().flush_soon()

    def pause_writing(self) -> None:
        """Begin no more calls: the caller reads more slowly than we answer."""
        self.writing_paused = True
        if self.transport is not None and not self.transport.is_closing():
            self.transport.pause_reading()

    def resume_writing(self) -> None:
        """Continue: the caller has read what was written."""
        self.writing_paused = False
        self._resume_reading()
        self.backpressure.measure(self)
        self.release()
        if self.subscriber is not None:
            self.subscriber.caught_up()

    def send_large(self, service: str, size: int) -> None:
        """Send a large response at once, so that a caller that does not read it is noticed."""
        transport = self.transport
        if transport is not None and transport.is_closing():
            # `connection_lost` follows; until then asyncio would log each attempt to write.
            self.writing_paused = True
            self.session.take()
        else:
            self.flush()
            self.backpressure.answered(service, self, size)

    def answer_in_thread(self, call: RemoteCall, body: bytes) -> bool:
        """Answer a call from another thread; False where only the event loop can."""
        return False

    def must_wait(self, call: RemoteCall) -> bool:
        """Whether a call may not begin yet, because too many responses are unread."""
        return self.writing_paused or self.backpressure.forbids(call.service)

    def hold(self, event: _Held) -> None:
        """Begin this request later, when this caller or other callers have read their responses."""
        if self._held is None:
            self._held = []
        self._held.append(event)
        if not self.writing_paused:  # otherwise `resume_writing` releases it
            self.backpressure.hold(self)

    def release(self) -> None:
        """Begin the requests that were held back; those without room are held again."""
        held, self._held = self._held, None
        for event in held or ():
            if isinstance(event, ResolveReceived):
                self._resolved(event)
            elif not event.cancelled:
                self._serve(event)
        self.flush_soon()

    @property
    def unread_limit(self) -> int:
        """Bytes that the caller may leave unread for a long time."""
        return 0 if self.backpressure.is_active else UNREAD_LIMIT

    def read_on(self) -> None:
        """Handle the remaining frames later: other connections come first."""
        if self.transport is not None and self.session.state is not ConnectionState.CLOSED:
            self.transport.pause_reading()
            self.owner.loop.call_soon(self._catch_up)

    def _catch_up(self) -> None:
        if self.transport is not None:
            self.buffer_updated(0)
            self._resume_reading()

    def _resume_reading(self) -> None:
        waits = self.writing_paused or self._splitter.behind
        if self.transport is not None and not waits and not self.transport.is_closing():
            self.transport.resume_reading()

    def expiring(self) -> Iterable[RemoteCall]:
        """The calls without a response."""
        return cast("list[RemoteCall]", self.session.open_tickets())

    def ended(self) -> None:
        """Cancel the calls that still run: the connection is gone."""
        if self._linger is not None:
            self._linger.cancel()
        self._held = None
        self.backpressure.left(self)
        self.server.calls_in_flight.left(self)
        if self.subscriber is not None:
            self.subscriber.left()
        for call in self.session.lost():
            call.lost()

    def drain(self) -> None:
        """Take no new calls; close after the last response."""
        self._draining = True
        self.session.drain()
        self.flush()

    def drained(self) -> None:
        """Close after the last response."""
        if self._linger is None and not self.session.in_flight:
            if self.why_closed is not None:
                self.refuse(self.why_closed)
            else:
                self._close_after(LINGER if self.session.state is ConnectionState.DRAINING else 0.0)

    def refuse(self, error: TaskRpcError) -> None:
        """End the connection; the caller has `LINGER` seconds to read the reason and to close."""
        self.why_closed = error
        self._close_after(LINGER)
        self.session.reject(error)
        self.flush()

    def check_account(self, accounts: Accounts, today: float) -> None:
        """Act on a change of the caller's account; `today` is in seconds since 1970.

        A revoked or expired account ends the connection. After any other change, the connection
        drains: the caller connects again and gets the rights that the account has now.
        """
        proved = self.account
        if proved is None or self.session.state is ConnectionState.CLOSED:
            return
        current = accounts.recheck(proved, today)
        if isinstance(current, str):
            _accounts_log.warning("closed the connection from %s: %s", self.peer_name, current)
            self._shut_out()
        elif current != proved and self.session.state is ConnectionState.OPEN:
            _accounts_log.info(
                "the account %s changed; its callers must connect again", proved.name
            )
            self.role = current.role
            if self.subscriber is not None:  # a long call keeps the connection for a while
                self.subscriber.role_changed()
            self.drain()

    def _shut_out(self) -> None:
        """Cancel the calls now, and end the connection even if the caller does not read."""
        error = AuthenticationFailed("the token is no longer valid for this server")
        self.refuse(error)
        for call in self.session.lost():
            call.cancel()
        self.owner.loop.call_later(_GRACE, self.abort, error)

    def _close_after(self, seconds: float) -> None:
        self._linger = self.owner.loop.call_later(seconds, self.close)

    def requested(self, event: RequestReceived) -> None:
        """Begin a call that is not plain; see `plain_serving`."""
        host, session = self.server, self.session
        route = self.routes.get(event.method)
        if route is None or route.method not in host.offers:
            gone = ServiceUnavailable("the service is no longer offered here")
            session.fail(event.call_id, gone)
            return
        try:
            request, received_id = read_request(route, event)
        except (InvalidRequest, PermissionDenied, ProtocolError) as error:
            session.fail(event.call_id, error)
            self._report_refusal(event.method, error)
            return
        event.body = b""  # frees the bytes: the call has the decoded message
        call = event.ticket = self.made_call(
            route,
            event.call_id,
            event.time_left,
            request,
            host.call_numbers.next(),
            self.read_at,
            received_id,
        )
        if self.writing_paused or self.backpressure.is_active:
            self._serve(call)
        else:
            route.offer.serve(call)

    def made_call(
        self,
        route: Route,
        call_id: int,
        time_left: int,
        request: object,
        number: int,
        arrived: float,
        received_id: ReceivedId | None = None,
    ) -> RemoteCall:
        """Return the record of a call, and watch its deadline.

        `arrived` is when it was read: earlier calls of the same read may have taken long since.
        """
        deadline = None
        if time_left != NO_DEADLINE:
            deadline = arrived + time_left / 1000
            if deadline < self.check_before:
                self.watch(deadline)
        # CPython passes more than 15 keyword arguments in a dict, which costs 0.5 µs.
        return route.call(
            service=route.offer.name,
            caller=route.caller,
            principal=self.principal,
            role=self.role,
            number=number,
            deadline=deadline,
            clock=self.server.now,
            request=request,
            received_id=received_id,
            arrived=arrived,
            connection=self,
            route=route,
            call_id=call_id,
        )

    def _large_request_began(self, event: LargeRequestBegan) -> None:
        if (refusal := self.server.calls_in_flight.refusal(self)) is not None:
            self.session.skip_large(refusal)
            self._report_refusal(event.method, refusal)

    def _quota_exceeded(self, event: QuotaExceeded) -> None:
        request, refusal = event.request, self.server.calls_in_flight.refusal(self)
        if refusal is None:
            self.requested(request)
        else:
            self.session.fail(request.call_id, refusal)
            self._report_refusal(request.method, refusal)

    def _serve(self, call: RemoteCall) -> None:
        if self.must_wait(call):
            self.hold(call)
        else:
            call.route.offer.serve(call)

    def _cancelled(self, event: CancelReceived) -> None:
        # Not part of the event: if REQUEST and CANCEL came in one read, the call is newer than it.
        if (call := event.request.ticket) is not None:
            call.cancelled_by_caller()

    def _limits_exceeded(self, event: LimitsExceeded) -> None:
        error = self.why_closed = event.error
        log.warning(
            "%s exceeded its limits; its connection closes after the last response: %s",
            self.peer_name,
            error,
        )
        self._draining = True

    def _opened(self, event: Ready) -> None:
        self.handshake_over()
        peer = event.peer
        self.caller = peer.name
        if (account := peer.account) is not None:
            self.account, self.principal, self.role = account, account.name, account.role
        where = None if self.transport is None else self.transport.get_extra_info("peername")
        self.quota_key = quota_key_of(self.principal, where)
        self.flow = self.quota_key if any(self.quota_key) else peer.id
        self.server.caller_proved(self)

    def _resolved(self, event: ResolveReceived) -> None:
        question = event.question
        if self.writing_paused:
            self.hold(event)
            return
        if not question.name:
            self.session.respond(event.call_id, messages.encode(self.server.listing()))
            return
        if question.name == STATISTICS:
            self.session.respond(event.call_id, messages.encode(self.server.statistics_for(self)))
            return
        method = self.server.method_of(question.name)
        offer = self.server.offers.get(method)
        store_id = offer.store_id() if offer is not None and offer.store_id is not None else None
        if store_id is not None and not store_id.done():
            store_id.add_done_callback(lambda known: self._resolve_late(event, method, known))
        elif (refusal := self.routes.refusal(question, offer)) is not None:
            self._lookup_failed(event, refusal)
        elif offer is not None:
            caller = question.caller or self.caller
            faults, account = self.server.faults, self.principal
            offer = self._measured(offer)
            self.routes = self.routes or Routes()
            handle = self.routes.add(offer, method, caller, account, self.role, faults)
            self.answers = self.answers or {}
            self.answers[handle] = answer_of(self, self.routes[handle])
            try:
                body = resolved(handle, offer, store_id, with_definition=event.with_definition)
            except TaskRpcError as error:
                self.session.fail(event.call_id, error)
            else:
                self.session.respond(event.call_id, messages.encode(body))
                if self.principal:
                    self.server.failed_lookups.pop(self.principal, None)

    def _lookup_failed(self, event: ResolveReceived, refusal: Refusal) -> None:
        self.session.fail(event.call_id, refusal.error)
        if refusal.drains:
            self.drain()
        elif self.principal:
            self.server.failed_lookups[self.principal] = event.question.name, refusal.exists

    def _subscribed(self, event: SubscribeReceived) -> None:
        if self.session.state is ConnectionState.OPEN:
            self.server.topics.subscriber_of(self).subscribe(event)

    def _unsubscribed(self, event: UnsubscribeReceived) -> None:
        if self.subscriber is not None:
            self.subscriber.unsubscribe(event.subscription_id)

    def _resolve_late(
        self, event: ResolveReceived, method: int, store_id: asyncio.Future[bytes]
    ) -> None:
        """Answer a RESOLVE that waited for its store to open or fail."""
        if self.transport is not None:
            error = store_id.exception()
            # Not `_resolved`: it would read the store again, without end.
            if method in self.server.offers and isinstance(error, TaskRpcError):
                self.session.fail(event.call_id, error)
            else:
                self._resolved(event)
            self.flush_soon()

    def measure(self) -> None:
        """Begin or end the measuring of later calls, as the server's meter says."""
        self.routes.reroute(self.server.offers, self._measured, self.server.faults)
        self.answers = {handle: answer_of(self, route) for handle, route in self.routes.items()}

    def _measured(self, offer: Offer) -> Offer:
        """The offer as this connection's routes need it: with the meter while it measures."""
        meter = self.server.meter
        return offer if meter is None or self in meter.watchers else meter.measured(offer)

    def _report_refusal(self, method: int, error: TaskRpcError) -> None:
        """Report a request to observers that was refused before it became a call."""
        route = self.routes.get(method)
        if route is None or route.call is RemoteCall:
            return
        refused(self, route, error)

    serves = True
    handlers: ClassVar = {
        RequestReceived: requested,
        LargeRequestBegan: _large_request_began,
        QuotaExceeded: _quota_exceeded,
        ResolveReceived: _resolved,
        CancelReceived: _cancelled,
        SubscribeReceived: _subscribed,
        UnsubscribeReceived: _unsubscribed,
        LimitsExceeded: _limits_exceeded,
        Ready: _opened,
        Closed: Connection._closed,
    }
