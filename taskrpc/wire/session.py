"""One end of a connection without its socket: bytes in and what happened out, what is wanted in
and bytes out.

The session knows frames, the handshake, call ids, what is in flight and who may still call. It
knows no clock: a deadline is the time left. Every call gets exactly one terminal frame (RESPONSE
or ERROR); only then are its id and its place in the limits free. After GOAWAY the server drops
newer calls unseen, and the client knows that they never began.
"""

from __future__ import annotations

from enum import Enum
from typing import Any

from taskrpc.errors import ConnectionLost, OutcomeUnknown, ProtocolError, TaskRpcError
from taskrpc.wire import messages, status
from taskrpc.wire.events import (
    Advertised,
    Answered,
    Body,
    CancelReceived,
    Closed,
    Draining,
    Event,
    Failed,
    Ready,
    RequestReceived,
    ResolveReceived,
)
from taskrpc.wire.frames import (
    FIRST_OPTIONAL_TYPE,
    LARGE,
    MAGIC,
    Frame,
    FrameType,
    Splitter,
    pack_frame,
    pack_header,
)
from taskrpc.wire.handshake import ClientHandshake, Identity, Peer, ServerHandshake, refusal
from taskrpc.wire.messages import DEFAULT_LIMITS

HANDSHAKE_LIMIT = 4096
"""Bytes of a body before the peer has proved itself."""

LAST_CALL_ID = 3 * 2**30
"""A connection that has made so many calls retires."""


class State(Enum):
    """Where a connection stands."""

    HANDSHAKE = "handshake"
    OPEN = "open"
    DRAINING = "draining"
    CLOSED = "closed"


class Session:
    """One connection, seen from one of its ends."""

    def __init__(self, me: Identity, *, is_client: bool) -> None:
        self.state = State.HANDSHAKE
        self.is_client = is_client
        self.last_call_id = 0
        """The newest call id: ours as a client, accepted as a server."""
        self._handshake = ClientHandshake(me) if is_client else ServerHandshake(me)
        self._limits = DEFAULT_LIMITS if is_client else me.limits
        self._their_limits = DEFAULT_LIMITS
        self._splitter = Splitter(HANDSHAKE_LIMIT)
        self._magic_seen = is_client
        self._head = b""
        self._pending: dict[int, tuple[Any, int]] = {}
        self._serving: dict[int, int] = {}
        self._bytes_in_flight = 0
        self._out: list[Body] = []
        if isinstance(self._handshake, ClientHandshake):
            self._out.append(self._handshake.start())

    # Bytes in, events out

    def room(self) -> memoryview | None:
        """Where the rest of a large body may be received directly; see `Splitter.room`."""
        return None if self.state is State.CLOSED else self._splitter.room()

    def filled(self, count: int) -> list[Event]:
        """Say that `count` bytes were written to `room()`; returns what happened."""
        return [] if self.state is State.CLOSED else self._handled(self._splitter.filled(count))

    def feed(self, data: bytes) -> list[Event]:
        """Take the next bytes from the peer; returns what happened.

        A peer that breaks the protocol yields `Closed` as the last event; nothing is read after it.
        """
        if self.state is State.CLOSED:
            return []
        try:
            if not self._magic_seen:
                data = self._after_magic(data)
            if self.state is State.HANDSHAKE:
                return self._feed_handshake(data)
            return self._handled(self._splitter.feed(data))
        except TaskRpcError as error:
            return [self._closed(error)]

    @property
    def mid_frame(self) -> bool:
        """Whether a frame from the peer has begun and not ended."""
        return self._splitter.mid_frame

    # Bytes out

    @property
    def has_output(self) -> bool:
        """Whether `take` has something to give."""
        return bool(self._out)

    def take(self) -> list[Body]:
        """What must be written to the peer now, in order; asks for it to be written once."""
        out, self._out = self._out, []
        return out

    # The calling side

    @property
    def in_flight(self) -> int:
        """Calls of ours without a terminal frame."""
        return len(self._pending)

    def can_send(self, size: int) -> bool:
        """Whether a request of `size` bytes fits into the peer's limits now."""
        limits = self._their_limits
        return (
            self.state is State.OPEN
            and len(self._pending) < limits.calls
            and (not self._pending or self._bytes_in_flight + size <= limits.bytes)
        )

    @property
    def body_limit(self) -> int:
        """Bytes of the largest body that the peer accepts."""
        return self._their_limits.body

    def request(self, ticket: Any, method: int, body: Body, time_left: int, flags: int = 0) -> int:
        """Send a request; `ticket` comes back with the answer. Returns the call id.

        The caller has asked `can_send` before.
        """
        call_id = self._next_call_id(ticket, len(body))
        self._send(FrameType.REQUEST, flags, method, call_id, time_left, body)
        return call_id

    def resolve(self, ticket: Any, question: messages.Resolve, *, definition: bool = False) -> int:
        """Ask for a service, or for a listing; `ticket` comes back with the answer."""
        body = messages.encode(question)
        call_id = self._next_call_id(ticket, len(body))
        self._send(FrameType.RESOLVE, 0, 0, call_id, int(definition), body)
        return call_id

    def cancel(self, call_id: int) -> None:
        """Give up a call: its answer will be dropped, the peer is told to stop."""
        held = self._pending.get(call_id)
        if held is not None and held[0] is not None:
            self._pending[call_id] = (None, held[1])
            self._send(FrameType.CANCEL, 0, 0, call_id, 0, b"")

    def lost(self) -> list[tuple[Any, OutcomeUnknown]]:
        """The connection is gone: every ticket without an answer, with what to tell its owner."""
        self.state = State.CLOSED
        pending, self._pending = self._pending, {}
        return [
            (
                ticket,
                OutcomeUnknown(
                    "the connection was lost before the answer came; the call may have run"
                ),
            )
            for ticket, _ in pending.values()
            if ticket is not None
        ]

    # The answering side

    @property
    def serving(self) -> int:
        """Calls of the peer's that we have not answered."""
        return len(self._serving)

    def respond(self, call_id: int, body: Body, server_time: int = 0) -> None:
        """Answer a call."""
        if self._done(call_id):
            self._send(FrameType.RESPONSE, 0, 0, call_id, min(server_time, 0xFFFFFFFF), body)

    def fail(self, call_id: int, error: TaskRpcError) -> None:
        """Answer a call with an error."""
        if self._done(call_id):
            wire = status.to_wire(error)
            arg = wire.code << 16 | wire.retry_after
            self._send(FrameType.ERROR, wire.flags, 0, call_id, arg, wire.body)

    def advertise(self) -> None:
        """Tell the peer that our services changed."""
        if self.state is State.OPEN:
            self._send(FrameType.ADVERTISE, 0, 0, 0, 0, b"")

    def drain(self) -> None:
        """Take no new calls; those in flight are still answered."""
        if self.state is State.OPEN:
            self.state = State.DRAINING
            self._send(FrameType.GOAWAY, 0, 0, 0, self.last_call_id, b"")

    # Both sides

    def ping(self, nonce: int) -> None:
        """Ask the peer for a sign of life."""
        self._send(FrameType.PING, 0, 0, 0, nonce, b"")

    # Inside

    def _after_magic(self, data: bytes) -> bytes:
        self._head += data
        if not MAGIC.startswith(self._head[: len(MAGIC)]):
            raise ProtocolError(
                f"the peer does not speak taskrpc: it began with {self._head[:16]!r}"
            )
        if len(self._head) < len(MAGIC):
            return b""
        self._magic_seen = True
        return self._head[len(MAGIC) :]

    def _feed_handshake(self, data: bytes) -> list[Event]:
        frames = self._splitter.feed(data)
        for index, frame in enumerate(frames):
            if frame[0] < FIRST_OPTIONAL_TYPE:
                self._shake_hands(frame)
            if self._handshake.peer is not None:
                ready = self._open(self._handshake.peer)
                # What came behind the handshake was measured by the handshake's small limit.
                rest = frames[index + 1 :] + self._splitter.feed(b"")
                return [ready, *self._handled(rest)]
        if self._splitter.error is not None:
            raise self._splitter.error
        return []

    def _shake_hands(self, frame: Frame) -> None:
        try:
            answer = self._handshake.receive(frame)
        except TaskRpcError as error:
            if not self.is_client:
                self._out.append(refusal(error))
            raise
        if answer:
            self._out.append(answer)

    def _open(self, peer: Peer) -> Ready:
        self.state = State.OPEN
        self._their_limits = peer.limits
        self._splitter.limit = self._limits.body
        return Ready(peer)

    def _handled(self, frames: list[Frame]) -> list[Event]:
        events: list[Event] = []
        for frame in frames:
            try:
                event = self._handle(*frame)
            except TaskRpcError as error:
                events.append(self._closed(error))
                break
            if event is not None:
                events.append(event)
        else:
            if self._splitter.error is not None:
                events.append(self._closed(self._splitter.error))
        return events

    def _handle(
        self, type_: int, flags: int, method: int, call_id: int, arg: int, body: Body
    ) -> Event | None:
        if type_ == FrameType.REQUEST:
            self._check_load(len(body))
            accepted = self._accept(call_id, len(body))
            return RequestReceived(call_id, method, flags, arg, body) if accepted else None
        if type_ == FrameType.RESPONSE:
            ticket = self._settled(call_id)
            return None if ticket is None else Answered(ticket, body, arg)
        return self._handle_control(type_, flags, call_id, arg, body)

    def _handle_control(
        self, type_: int, flags: int, call_id: int, arg: int, body: Body
    ) -> Event | None:
        match type_:
            case FrameType.ERROR:
                return self._on_error(flags, call_id, arg, body)
            case FrameType.RESOLVE:
                question = messages.decode_resolve(body)
                accepted = self._accept(call_id, len(body))
                return ResolveReceived(call_id, question, bool(arg)) if accepted else None
            case FrameType.CANCEL:
                return CancelReceived(call_id) if call_id in self._serving else None
            case FrameType.PING:
                self._send(FrameType.PONG, 0, 0, 0, arg, b"")
            case FrameType.ADVERTISE | FrameType.GOAWAY if not self.is_client:
                raise ProtocolError(f"frame type {type_} is not a client's to send")
            case FrameType.ADVERTISE:
                return Advertised()
            case FrameType.GOAWAY:
                return self._on_goaway(arg)
            case FrameType.PONG:
                pass
            case _ if type_ < FIRST_OPTIONAL_TYPE:
                raise ProtocolError(f"frame type {type_} is not part of this protocol")
        return None

    def _check_load(self, size: int) -> None:
        # Only requests: questions are answered at once, and clients ask without counting.
        limits = self._limits
        if len(self._serving) >= limits.calls:
            raise ProtocolError(f"more than {limits.calls} calls in flight on one connection")
        if self._serving and self._bytes_in_flight + size > limits.bytes:
            raise ProtocolError(f"more than {limits.bytes} bytes in flight on one connection")

    def _accept(self, call_id: int, size: int) -> bool:
        if self.is_client:
            raise ProtocolError("a server may not call")
        if call_id <= self.last_call_id:
            raise ProtocolError(f"call id {call_id} came after {self.last_call_id}")
        if self.state is State.DRAINING:
            # It crossed our GOAWAY, which tells the caller that it never began.
            return False
        self.last_call_id = call_id
        self._serving[call_id] = size
        self._bytes_in_flight += size
        return True

    def _done(self, call_id: int) -> bool:
        size = self._serving.pop(call_id, None)
        if size is None:
            return False
        self._bytes_in_flight -= size
        return self.state is not State.CLOSED

    def _next_call_id(self, ticket: Any, size: int) -> int:
        self.last_call_id = call_id = self.last_call_id + 1
        self._pending[call_id] = (ticket, size)
        self._bytes_in_flight += size
        return call_id

    def _settled(self, call_id: int) -> Any:
        held = self._pending.pop(call_id, None)
        if held is None:
            raise ProtocolError(f"an answer to call {call_id}, which is not in flight")
        self._bytes_in_flight -= held[1]
        return held[0]

    def _on_error(self, flags: int, call_id: int, arg: int, body: Body) -> Event | None:
        error = status.from_wire(arg >> 16, flags, arg & 0xFFFF, body)
        if call_id == 0:
            raise error
        ticket = self._settled(call_id)
        return None if ticket is None else Failed(ticket, error)

    def _on_goaway(self, last_accepted: int) -> Draining:
        if self.state is State.OPEN:
            self.state = State.DRAINING
        never_begun = [call_id for call_id in self._pending if call_id > last_accepted]
        refused = [self._pending.pop(call_id)[0] for call_id in never_begun]
        return Draining([ticket for ticket in refused if ticket is not None])

    def _closed(self, error: TaskRpcError) -> Closed:
        self.state = State.CLOSED
        return Closed(error)

    def _send(
        self, type_: int, flags: int, method: int, call_id: int, arg: int, body: Body
    ) -> None:
        if len(body) < LARGE:
            self._out.append(pack_frame(type_, flags, method, call_id, arg, body))
        else:
            self._out.append(pack_header(type_, flags, method, call_id, arg, len(body)))
            self._out.append(body)


def refused_error() -> ConnectionLost:
    """What the owner of a call learns that a draining server never began."""
    return ConnectionLost(
        "the server is shutting down and did not begin this call", not_executed=True
    )
