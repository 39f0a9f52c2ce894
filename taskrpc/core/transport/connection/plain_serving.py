"""The plain path of a server: from the bytes of a read to the callback, and back to the output.

`answer_of` makes one function for each route; `Session.serve` calls it with each request. For a
plain request, it runs the callback and returns the encoded response, without a call record, an
event or a timer. It passes any other request to `ServingConnection.requested`.

A request is plain if all of this holds:

1. The route has no observer and no faults, DEBUG logging is off, and the service is not threaded.
   If it is exactly-once, its store completes requests at once. This is decided once for each route.
2. The request has no trace span. It has a request id if the service is exactly-once, and its
   store's ledger admits it: it is certainly new.
3. The service is still offered, may run one more call, and no call waits for it.
4. The caller reads its responses, and backpressure is not active.
5. The body is valid, and the caller's role is sufficient. The deadline has not passed.

An async callback takes the same path: its coroutine runs up to its end or its first suspension.

After the callback, the call gets its record and goes on as any other call if the callback read
`current_call()`, raised, suspended, returned something else than a response, or if the response is
invalid or large. The path makes no error itself, so each error has one origin.
"""

from __future__ import annotations

from collections.abc import Callable
from types import CoroutineType
from typing import Any, Protocol

import msgspec

from taskrpc.core.callinfo import answering
from taskrpc.core.request_ids.ids import Completion, ReceivedId
from taskrpc.core.transport.base import CallNumbers, IncomingCall, Offer, PlainService
from taskrpc.core.transport.codec import pack
from taskrpc.core.transport.connection.incoming_call import RemoteCall, Route
from taskrpc.core.transport.limits.backpressure import Backpressure
from taskrpc.core.wire.events import RequestReceived
from taskrpc.core.wire.frames import LARGE, NO_DEADLINE, Flag
from taskrpc.core.wire.session import Answer, Session
from taskrpc.errors import InvalidRequest, PermissionDenied, ProtocolError


class PlainServer(Protocol):
    """What the path needs from the process."""

    offers: dict[int, Offer]
    call_numbers: CallNumbers
    now: Callable[[], float]


class PlainConnection(Protocol):
    """What the path needs from the connection."""

    session: Session
    principal: str
    backpressure: Backpressure
    writing_paused: bool
    read_at: float
    clock_at: float
    """The latest reading of the clock in the present read."""

    @property
    def server(self) -> PlainServer:
        """The process that takes the calls."""

    def requested(self, request: RequestReceived) -> None:
        """Handle a request in the general way."""

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
        """Return the record of a call, and watch its deadline."""


class PlainCall(msgspec.Struct, eq=False):
    """A call that has no record yet; `made` makes it."""

    connection: PlainConnection
    route: Route
    call_id: int
    time_left: int
    request: Any
    number: int
    arrived: float
    size: int
    """Bytes of the request."""
    body: bytes
    """The request with its id, if it has one; empty once there is a record."""
    call: IncomingCall | None = None
    """The record, once the callback or the service has asked for it."""
    ended: bool = False
    """Whether the call was answered; a task that its callback began may still ask for it."""

    def made(self) -> IncomingCall:
        """Return the record; the call is in flight from now on."""
        if self.call is None:
            connection, call_id, left = self.connection, self.call_id, self.time_left
            route, received = self.route, None
            service = route.offer.plain
            assert service is not None, "the route has a plain path"
            once = service.once
            if once is not None:
                client, sequence, first, fingerprint, _ = route.split_id(self.body)
                received = ReceivedId(client, sequence, first, fingerprint)
            self.body = b""
            call = connection.made_call(
                route, call_id, left, self.request, self.number, self.arrived, received
            )
            self.call = call
            if once is None:
                call.started = True
            else:
                self.call = once.executed(call, is_over=self.ended)
            if not self.ended:
                session, handle = connection.session, route.handle
                session.accept(call_id, handle, 0, left, b"", self.size).ticket = call
        return self.call


def answer_of(connection: PlainConnection, route: Route) -> Answer:
    """Return the function that takes the calls of a route."""
    service = route.offer.plain
    if service is None or route.call is not RemoteCall:
        return _general(connection, route)
    return _plain(connection, route, service)


def _general(connection: PlainConnection, route: Route) -> Answer:
    session, handle = connection.session, route.handle

    def answer(call_id: int, flags: int, time_left: int, body: bytes, size: int) -> None:
        connection.requested(session.accept(call_id, handle, flags, time_left, body, size))

    return answer


def _plain(  # noqa: PLR0915 (a function for each part would cost a tenth of a call)
    connection: PlainConnection, route: Route, service: PlainService
) -> Answer:
    session, server, backpressure = connection.session, connection.server, connection.backpressure
    offers, numbers, now = server.offers, server.call_numbers, server.now
    handle, method, waiting = route.handle, route.method, service.waiting
    decode, principal = route.decode, connection.principal
    callback, response_class, once = service.callback, service.response, service.once
    flags_of_route, split_id = 0 if once is None else int(Flag.EXACTLY_ONCE), route.split_id
    set_answering, reset_answering = answering.set, answering.reset
    limit = min(session.body_limit, LARGE - 1)

    def answer(  # noqa: PLR0912, PLR0915 (runs for each call)
        call_id: int, flags: int, time_left: int, body: bytes, size: int
    ) -> tuple[bytes, int, int] | None:
        arrived, began = connection.read_at, connection.clock_at
        request = record = None
        if (
            flags == flags_of_route
            and service.running < service.concurrency
            and not waiting.count
            and method in offers
            and not connection.writing_paused
            and not backpressure.is_active
            and (time_left == NO_DEADLINE or arrived + time_left / 1000 > began)
        ):
            try:
                if once is None:
                    request = decode(body)
                else:
                    client, sequence, first, fingerprint, message = split_id(body)
                    state = once.state
                    ledger, clock = state.ledger, state.clock
                    if (
                        ledger is not None
                        and clock is not None
                        and (at := arrived + clock.offset) < state.next_expiry
                    ):
                        request = decode(message)
                        record = ledger.admit(principal, client, sequence, first, at)
                        if record is None:
                            request = None  # the general path decides: it may be no new request
            except (InvalidRequest, PermissionDenied, ProtocolError):
                request = None  # decoded again, to report the error
        if request is None:
            connection.requested(session.accept(call_id, handle, flags, time_left, body, size))
            connection.clock_at = now()
            return None
        service.running += 1
        numbers.last = number = numbers.last + 1
        call = PlainCall(
            connection, route, call_id, time_left, request, number, arrived, size, body
        )
        encoded, go_on = None, service.returned
        token = set_answering(call)
        try:
            try:
                response = callback(request, response_class())
                if response.__class__ is CoroutineType:
                    response, go_on = service.begin(call, response)
            except BaseException as error:
                response, go_on = error, service.raised
            if response.__class__ is response_class and call.call is None:
                try:
                    response._check()
                    encoded = pack(response)
                except Exception:
                    encoded = None  # encoded again, to report the error
            if encoded is None or (length := len(encoded)) > limit:
                go_on(call.made(), response, began)
                connection.clock_at = now()
                return None
            if record is not None and once is not None:
                completion = Completion(
                    principal, client, sequence, first, fingerprint, encoded, 0, at
                )
                once.complete(completion, record)
            call.ended = True
            connection.clock_at = ended = now()
            if ended - began > service.holds_after:
                service.held(ended - began)
        finally:
            reset_answering(token)
        service.running -= 1
        if waiting.count or method not in offers:
            service.finished(began)
        return encoded, length, int((ended - arrived) * 1e6 + 0.5)

    return answer
