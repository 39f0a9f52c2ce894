"""One end of a connection without its socket: bytes and requests in, events and bytes out.

`Session` handles calls, their ids and limits; its base class handles frames and the handshake. It
has no clock: a deadline is sent as the time that is left. Every call gets exactly one terminal
frame (RESPONSE or ERROR); until then it counts against the limits. After GOAWAY the server ignores
newer calls, and the client knows that they never began.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeAlias

from taskrpc.core.wire import messages, status, topics
from taskrpc.core.wire.base_session import BaseSession
from taskrpc.core.wire.connection_state import ConnectionState, StateEvent
from taskrpc.core.wire.events import (
    CancelReceived,
    Draining,
    ErrorReceived,
    Event,
    LargeRequestBegan,
    LimitsExceeded,
    QuotaExceeded,
    RequestReceived,
    ResolveReceived,
    ResponseReceived,
    ServicesChanged,
)
from taskrpc.core.wire.frames import (
    FIRST_OPTIONAL_TYPE,
    HEADER,
    LARGE,
    SIZE_OF_EMPTY,
    Body,
    Frame,
    FrameType,
    LargeBody,
    pack_frame,
)
from taskrpc.core.wire.handshake import Identity
from taskrpc.errors import ConnectionLost, OutcomeUnknown, ProtocolError, TaskRpcError

LAST_CALL_ID = 3 * 2**30
"""The highest call id of a connection; then a client uses a new connection."""

LONGEST_TIME = 0xFFFFFFFF
"""The longest server time in a response, in microseconds; longer calls report this value."""


# Module constants: to look up a member of an enum takes as long as to pack a header.
_, _OPEN, _DRAINING, _CLOSED = ConnectionState
_REQUEST, _RESPONSE = int(FrameType.REQUEST), int(FrameType.RESPONSE)
_SUBSCRIBE, _PUBLISH = int(FrameType.SUBSCRIBE), int(FrameType.PUBLISH)
_pack, _unpack = HEADER.pack, HEADER.unpack_from
_HEADER_SIZE = HEADER.size
_LENGTH_SIZE = _HEADER_SIZE - SIZE_OF_EMPTY


Answer: TypeAlias = "Callable[[int, int, int, bytes, int], tuple[bytes, int, int] | None]"
"""Takes a call: the call id, the flags, the milliseconds until its deadline, and the body with its
size.

It returns the response's body, smaller than LARGE and within the peer's limit, its size, and the
server time in microseconds. Or it returns None: then it has passed the call to `Session.accept`."""


class Session(BaseSession):
    """One connection, seen from one of its ends."""

    __slots__ = (
        "answers_pings",
        "bytes_in_flight",
        "free_bytes",
        "free_calls",
        "last_call_id",
        "open_calls",
    )

    def __init__(self, me: Identity, *, is_client: bool, frames_a_turn: int = sys.maxsize) -> None:
        super().__init__(me, is_client=is_client)
        self.splitter.most = frames_a_turn
        self.last_call_id = 0
        """The newest call id: sent by a client, accepted by a server."""
        self.free_calls, self.free_bytes = self.limits.calls, self.limits.bytes
        """Calls and bytes that may be in flight before a request is reported as `QuotaExceeded`."""
        self.open_calls: dict[int, Any] = {}
        """Calls without a terminal frame, by call id. The value is (ticket, size) for a client, and
        the request for a server."""
        self.bytes_in_flight = 0
        """Bytes of the requests in `open_calls`."""
        self.answers_pings = True
        """False while the peer does not read, because PONG frames would only pile up."""

    def set_quota(self, calls: int, size: int) -> None:
        """Set `free_calls` and `free_bytes`."""
        self.free_calls, self.free_bytes = calls, size

    def answer_pings(self, *, wanted: bool) -> None:
        """Set whether to answer PING frames; see `answers_pings`."""
        self.answers_pings = wanted

    # Bytes in, events out. A frame takes effect when its event is due, after the earlier events of
    # the same read have been handled: iterate to the end.

    def filled(self, count: int) -> Iterable[Event]:
        """Count bytes that were written to `splitter.large`; return the events."""
        return () if self.state is _CLOSED else self.handled(self.splitter.filled(count))

    def feed(self, data: bytes, done: int = 0) -> Iterable[Event]:
        """Process the next bytes from the peer; return the events.

        `done` frames of the same read were processed before. If the peer breaks the protocol, the
        last event is `Closed`; nothing is read afterwards.
        """
        if self.state is _CLOSED:
            return ()
        if self.handshake is not None:
            return self.feed_handshake(self.handshake, data)
        if self.state is _OPEN and (frame := self.splitter.only(data)) is not None:
            try:
                event = self._event(frame)
            except TaskRpcError as error:
                return (self._closed(error),)
            return () if event is None else (event,)
        return self.handled(self.splitter.feed(data, done))

    # The two frames of a call, without events. Both methods do the same as `feed`, with a third of
    # its function calls, and leave all other frames to it; a test compares them.

    def responses(self, data: bytes, size: int) -> tuple[list[tuple[Any, Body]], bytes]:
        """Process the responses with which a client's read of `size` bytes begins.

        Return the tickets of their calls, each with the body, and the bytes that are left for
        `feed`: from the first frame on that is no whole response to a call that is open.
        """
        splitter, open_calls = self.splitter, self.open_calls
        found: list[tuple[Any, Body]] = []
        if self.state is not _OPEN or splitter.large is not None:
            return found, data
        if splitter.tail:
            data = splitter.take_tail() + data
            size = len(data)
        start = 0
        while size - start >= _HEADER_SIZE:
            length, type_, _, _, call_id, _ = _unpack(data, start)
            body, end = start + _HEADER_SIZE, start + _LENGTH_SIZE + length
            if type_ != _RESPONSE or not body <= end <= size or end - body > splitter.limit:
                break
            if call_id not in open_calls:
                break
            ticket, request_size = open_calls[call_id]
            del open_calls[call_id]
            self.bytes_in_flight -= request_size
            if ticket is not None:
                found.append((ticket, data[body:end]))
            start = end
        return found, data[start:]

    def serve(
        self, data: bytes, size: int, answers: Mapping[int, Answer], most: int
    ) -> tuple[bytes, int]:
        """Pass the requests with which a read of `size` bytes begins to `answers`, at most `most`.

        `answers` has a function for each method id. Return the bytes that are left for `feed`, and
        how many requests were left of `most`. Left are all frames from the first one on that is no
        whole request with a known method, or exceeds a quota.
        """
        splitter, open_calls = self.splitter, self.open_calls
        if splitter.large is not None or self.state is not _OPEN:
            return data, most
        if splitter.tail:
            data = splitter.take_tail() + data
            size = len(data)
        start = 0
        while size - start >= _HEADER_SIZE and most and self.state is _OPEN:
            length, type_, flags, method, call_id, time_left = _unpack(data, start)
            body, end = start + _HEADER_SIZE, start + _LENGTH_SIZE + length
            if (
                type_ != _REQUEST
                or not body <= end <= size
                or end - body > splitter.limit
                or call_id <= self.last_call_id
                or method not in answers
            ):
                break
            if open_calls and (
                len(open_calls) >= self.free_calls
                or self.bytes_in_flight + end - body > self.free_bytes
            ):
                break
            self.last_call_id = call_id
            answered = answers[method](call_id, flags, time_left, data[body:end], end - body)
            if answered is not None and self.state is not _CLOSED:
                response, length, server_time = answered
                if server_time > LONGEST_TIME:  # noqa: PLR1730 (calling min costs more)
                    server_time = LONGEST_TIME
                length += SIZE_OF_EMPTY
                self.out.append(_pack(length, _RESPONSE, 0, 0, call_id, server_time) + response)
            start = end
            most -= 1
        return data[start:], most

    def accept(
        self, call_id: int, method: int, flags: int, time_left: int, body: Body, size: int
    ) -> RequestReceived:
        """Count a call as in flight that an `Answer` does not answer at once."""
        request = RequestReceived(call_id, method, flags, time_left, body, size)
        self.bytes_in_flight += size
        self.open_calls[call_id] = request
        return request

    # The client's side

    @property
    def in_flight(self) -> int:
        """The number of calls without a terminal frame."""
        return len(self.open_calls)

    def request(self, ticket: Any, method: int, body: Body, time_left: int, flags: int = 0) -> int:
        """Send a request; `ticket` is returned with the response. Return the call id.

        Return 0, and send nothing, if the request does not fit into the peer's limits now.
        """
        size = len(body)
        if size < LARGE:
            frame = self.request_frame(ticket, method, body, time_left, flags, size)
            if not frame:
                return 0
            self.out.append(frame)
        elif self.request_frame(ticket, method, b"", time_left, flags, size):
            self.send(_REQUEST, flags, method, self.last_call_id, time_left, body)
        else:
            return 0
        return self.last_call_id

    def request_frame(
        self, ticket: object, method: int, body: Body, time_left: int, flags: int, size: int
    ) -> bytes:
        """Begin a call, and return its frame, which the caller writes or adds to `out`.

        Its call id is `last_call_id`. Return b"" if the request does not fit into the peer's limits
        now. The body has `size` bytes.
        """
        open_calls = self.open_calls
        if self.state is not _OPEN:
            return b""
        if open_calls:  # a single request may exceed the limit for all requests together
            limits = self.their_limits
            if len(open_calls) >= limits.calls or self.bytes_in_flight + size > limits.bytes:
                return b""
        self.last_call_id = call_id = self.last_call_id + 1
        open_calls[call_id] = (ticket, size)
        self.bytes_in_flight += size
        return _pack(SIZE_OF_EMPTY + size, _REQUEST, flags, method, call_id, time_left) + body

    def resolve(self, ticket: Any, question: messages.Resolve, *, definition: bool = False) -> int:
        """Ask for a service, or for a listing; `ticket` is returned with the response."""
        body = messages.encode(question)
        self.last_call_id = call_id = self.last_call_id + 1
        self.open_calls[call_id] = (ticket, len(body))
        self.bytes_in_flight += len(body)
        self.send(FrameType.RESOLVE, 0, 0, call_id, int(definition), body)
        return call_id

    def cancel(self, call_id: int) -> None:
        """Cancel a call: ask the peer to stop it, and ignore its response."""
        self.ask_to_stop(call_id)
        self.drop(call_id)

    def ask_to_stop(self, call_id: int) -> None:
        """Ask the peer to stop a call; the response is still reported."""
        held = self.open_calls.get(call_id)
        if held is not None and held[0] is not None:
            self.send(FrameType.CANCEL, 0, 0, call_id, 0, b"")

    def drop(self, call_id: int) -> None:
        """Ignore the response to a call."""
        held = self.open_calls.get(call_id)
        if held is not None:
            self.open_calls[call_id] = (None, held[1])

    def open_tickets(self) -> list[Any]:
        """Return the tickets of all calls that are in flight and not cancelled."""
        calls = list(self.open_calls.values())  # a copy: another thread may end a call at any time
        tickets = [call[0] for call in calls] if self.is_client else [call.ticket for call in calls]
        return [ticket for ticket in tickets if ticket is not None]

    def lost(self) -> list[Any]:
        """End the session; return the tickets of all calls without a response.

        See `unknown_error` for their error.
        """
        tickets = self.open_tickets()
        self.advance(StateEvent.END)
        self.open_calls = {}
        return tickets

    # The server's side

    def respond(self, call_id: int, body: Body, server_time: int = 0) -> bool:
        """Send a response; False if the call has ended. `server_time` is in microseconds."""
        request = self.open_calls.pop(call_id, None)
        if request is None:
            return False
        if server_time > LONGEST_TIME:  # noqa: PLR1730 (calling min costs more than the rest)
            server_time = LONGEST_TIME
        size = len(body)
        self.bytes_in_flight -= request.size
        if size < LARGE and self.state is not _CLOSED:
            header = _pack(SIZE_OF_EMPTY + size, _RESPONSE, 0, 0, call_id, server_time)
            self.out.append(header + body)
        else:
            self.send(_RESPONSE, 0, 0, call_id, server_time, body)
        return True

    def pop_response(self, call_id: int, body: bytes, server_time: int) -> tuple[bytes, int] | None:
        """End a call; return its response as a frame that another thread writes, without `out`.

        Also return the size of the request; pass it to `freed` on the session's own thread. Return
        None if the call has ended. The body must be smaller than LARGE.
        """
        request = self.open_calls.pop(call_id, None)
        if request is None:
            return None
        time = min(server_time, LONGEST_TIME)
        return pack_frame(_RESPONSE, 0, 0, call_id, time, body), request.size

    def freed(self, size: int) -> None:
        """Count the request of `pop_response`, of so many bytes, as no longer in flight."""
        self.bytes_in_flight -= size

    def fail(self, call_id: int, error: TaskRpcError) -> bool:
        """Send an error for a call; False if the call has ended."""
        request = self.open_calls.pop(call_id, None)
        if request is None:
            return False
        self.bytes_in_flight -= request.size
        wire = status.to_wire(error)
        arg = wire.code << 16 | wire.retry_after
        self.send(FrameType.ERROR, wire.flags, 0, call_id, arg, wire.body)
        return True

    @property
    def bytes_coming(self) -> int:
        """Bytes of the requests in flight, including a large one that is arriving."""
        large = self.splitter.large
        return self.bytes_in_flight + (0 if large is None else large.size)

    def skip_large(self, error: TaskRpcError) -> None:
        """Refuse the large request that is arriving; its bytes are discarded."""
        large = self.splitter.large
        if large is not None:
            _, _, method, call_id, _ = large.header
            large.skip()
            self.last_call_id = call_id
            self.open_calls[call_id] = RequestReceived(call_id, method, 0, 0, b"", 0)
            self.fail(call_id, error)

    def advertise(self) -> None:
        """Tell the peer that our services changed."""
        if self.state is _OPEN:
            self.send(FrameType.ADVERTISE, 0, 0, 0, 0, b"")

    def drain(self) -> None:
        """Send GOAWAY: accept no new calls, but finish those in flight."""
        if self.state is _OPEN:
            self.advance(StateEvent.DRAIN)
            self.send(FrameType.GOAWAY, 0, 0, 0, self.last_call_id, b"")

    # Frames to events

    def handled(self, frames: Iterable[Frame]) -> Iterator[Event]:
        """Yield the events of frames that arrived after the handshake."""
        try:
            for frame in frames:
                if self.state is _CLOSED:  # an earlier event has closed the connection
                    return
                event = self._event(frame)
                if event is not None:
                    yield event
        except TaskRpcError as error:
            yield self._closed(error)
            return
        large = self.splitter.large
        if self.splitter.error is not None:
            yield self._closed(self.splitter.error)
        elif large is not None and not large.is_announced:
            large.is_announced = True
            if self.bytes_coming > self.free_bytes and self._is_next(large):
                yield LargeRequestBegan(large.header[2], large.size)

    def _is_next(self, large: LargeBody) -> bool:
        """Whether the large body that is arriving is a request that may begin."""
        type_, _, _, call_id, _ = large.header
        return (
            type_ == _REQUEST
            and self.state is _OPEN
            and call_id > self.last_call_id
            and not self.is_client
        )

    def _event(self, frame: Frame) -> Event | None:
        # The two frames of a call are handled here: a function for each would cost 1 % of a call.
        type_, flags, method, call_id, arg, body = frame
        if type_ == _RESPONSE:
            ticket = self._settled(call_id)
            return None if ticket is None else ResponseReceived(ticket, body, arg)
        if type_ != _REQUEST:
            if _SUBSCRIBE <= type_ <= _PUBLISH:
                return topics.received(frame, is_client=self.is_client)
            return self._on_control(type_, flags, call_id, arg, body)
        size, open_calls = len(body), self.open_calls
        # Requests only: a server answers RESOLVE at once, and clients do not count it.
        exceeds_quota = len(open_calls) >= self.free_calls
        if open_calls and (exceeds_quota or self.bytes_in_flight + size > self.free_bytes):
            if self._is_full(size):
                return self._overrun()
            exceeds_quota = True
        if self.is_client or call_id <= self.last_call_id or self.state is _DRAINING:
            self._refuse(call_id)
            return None
        self.last_call_id = call_id
        self.bytes_in_flight += size
        request = RequestReceived(call_id, method, flags, arg, body, size)
        open_calls[call_id] = request
        return QuotaExceeded(request) if exceeds_quota else request

    def _on_resolve(self, call_id: int, arg: int, body: Body) -> ResolveReceived | None:
        question = messages.decode_resolve(body)
        if self.is_client or call_id <= self.last_call_id or self.state is _DRAINING:
            self._refuse(call_id)
            return None
        self.last_call_id = call_id
        self.bytes_in_flight += len(body)
        resolve = ResolveReceived(call_id, question, bool(arg), len(body))
        self.open_calls[call_id] = resolve
        return resolve

    def _on_control(
        self, type_: int, flags: int, call_id: int, arg: int, body: Body
    ) -> Event | None:
        match type_:
            case FrameType.ERROR:
                return self._on_error(flags, call_id, arg, body)
            case FrameType.RESOLVE:
                return self._on_resolve(call_id, arg, body)
            case FrameType.CANCEL if not self.is_client:
                request = self.open_calls.get(call_id)
                return None if request is None else CancelReceived(call_id, request)
            case FrameType.PING if self.answers_pings:
                self.send(FrameType.PONG, 0, 0, 0, arg, b"")
            case FrameType.ADVERTISE | FrameType.GOAWAY if not self.is_client:
                raise ProtocolError(f"a client may not send frame type {type_}")
            case FrameType.ADVERTISE:
                return ServicesChanged()
            case FrameType.GOAWAY:
                return self._on_goaway(arg)
            case FrameType.PING | FrameType.PONG:
                pass
            case _ if type_ < FIRST_OPTIONAL_TYPE:
                raise ProtocolError(f"frame type {type_} is not part of this protocol")
        return None

    def _is_full(self, size: int) -> bool:
        """Whether a further request of `size` bytes would exceed the limits."""
        limits = self.limits
        many = len(self.open_calls) >= limits.calls
        return many or self.bytes_in_flight + size > limits.bytes

    def _overrun(self) -> LimitsExceeded | None:
        if self.is_client:
            raise ProtocolError("a server may not call")
        if self.state is _DRAINING:
            return None
        self.drain()
        limits = self.limits
        too_many = len(self.open_calls) >= limits.calls
        limit = f"{limits.calls} calls" if too_many else f"{limits.bytes} bytes"
        return LimitsExceeded(ProtocolError(f"more than {limit} in flight on one connection"))

    def _refuse(self, call_id: int) -> None:
        """Ignore a call that the client sent before it received GOAWAY; it never began.

        Raises ProtocolError for any other call that may not begin.
        """
        if self.is_client:
            raise ProtocolError("a server may not call")
        if call_id <= self.last_call_id:
            raise ProtocolError(f"call id {call_id} follows {self.last_call_id}; ids must increase")

    def _settled(self, call_id: int) -> Any:
        held = self.open_calls.pop(call_id, None) if self.is_client else None
        if held is None:
            raise ProtocolError(f"a response to call {call_id}, which is not in flight")
        self.bytes_in_flight -= held[1]
        return held[0]

    def _on_error(self, flags: int, call_id: int, arg: int, body: Body) -> Event | None:
        error = status.from_wire(arg >> 16, flags, arg & 0xFFFF, body)
        if call_id == 0:
            raise error
        ticket = self._settled(call_id)
        return None if ticket is None else ErrorReceived(ticket, error)

    def _on_goaway(self, last_accepted: int) -> Draining:
        if self.state is _OPEN:
            self.advance(StateEvent.DRAIN)
        never_begun = [call_id for call_id in self.open_calls if call_id > last_accepted]
        refused = [self.open_calls.pop(call_id)[0] for call_id in never_begun]
        return Draining([ticket for ticket in refused if ticket is not None])


def unknown_error() -> OutcomeUnknown:
    """Return the error for a call that was in flight when its connection was lost."""
    return OutcomeUnknown(
        "the connection was lost before the response arrived; the call may have run"
    )


def refused_error() -> ConnectionLost:
    """Return the error for a call that a draining server never began."""
    return ConnectionLost(
        "the server is shutting down and did not begin this call", not_executed=True
    )
