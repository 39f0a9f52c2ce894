"""The calling end of a connection: calls as futures, queued while the peer's limits are reached."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable
from typing import Any

from taskrpc.errors import (
    ConnectionLost,
    DeadlineExceeded,
    InvalidRequest,
    ProtocolError,
    ServiceUnavailable,
    TaskRpcError,
)
from taskrpc.transport.connection import Connection, Owner
from taskrpc.wire import messages
from taskrpc.wire.events import Advertised, Answered, Body, Draining, Event, Failed, Ready
from taskrpc.wire.frames import LARGE, NO_DEADLINE
from taskrpc.wire.handshake import Identity
from taskrpc.wire.session import LAST_CALL_ID, refused_error

MAX_MOVES = 8
"""How often one call may be refused and sent elsewhere before its caller learns of it."""


class CallFuture(asyncio.Future[Any]):
    """A call in flight: yields the decoded answer; cancelling it cancels the call.

    `move` takes a call that the server certainly did not begin, to send it elsewhere.
    """

    __slots__ = (
        "_decode",
        "_move",
        "_moves",
        "body",
        "call_id",
        "connection",
        "deadline",
        "method",
        "slot",
    )

    def __init__(
        self,
        connection: CallingConnection,
        decode: Callable[[Body], Any],
        deadline: float | None,
        *,
        method: int = 0,
        body: Body = b"",
        move: Callable[[CallFuture], object] | None = None,
    ) -> None:
        super().__init__(loop=connection.owner.loop)
        self.connection = connection
        self._decode = decode
        self._move = move
        self._moves = 0
        self.deadline = deadline
        self.method = method
        self.body = body
        self.call_id = 0
        """0 until the request is sent."""
        self.slot = connection.owner.deadlines.add(deadline, self) if deadline is not None else 0

    def answered(self, body: Body) -> None:
        """The response came."""
        if not self.done():
            self._end()
            try:
                self.set_result(self._decode(body))
            except (InvalidRequest, ProtocolError) as error:
                self.set_exception(_bad_answer(error))

    def failed(self, error: BaseException) -> None:
        """The call ended with an error."""
        if not self.done():
            self._end()
            self.set_exception(error)

    def refused(self, error: TaskRpcError) -> None:
        """The server certainly did not begin the call, and will take no such call any more."""
        if self._move is None or self._moves >= MAX_MOVES:
            self.failed(error)
        elif not self.done():
            self._moves += 1
            self.call_id = 0
            self._move(self)

    def expired(self) -> None:
        """The deadline passed: tell the caller at once, and the server that nobody waits."""
        if not self.done():
            self.connection.forget(self)
            self.body = b""
            sent = None if self.call_id else True
            self.set_exception(DeadlineExceeded("no answer by the deadline", not_executed=sent))

    def cancel(self, msg: Any | None = None) -> bool:
        """Give the call up."""
        if self.done():
            return False
        self._end()
        self.connection.forget(self)
        return super().cancel(msg)

    def _end(self) -> None:
        self.body = b""
        if self.deadline is not None:
            self.connection.owner.deadlines.discard(self.slot, self)


class CallingConnection(Connection):
    """A connection on which we call; shared by all channels to the same process."""

    def __init__(
        self, owner: Owner, me: Identity, on_advertised: Callable[[], object] = lambda: None
    ) -> None:
        super().__init__(owner, me, is_client=True)
        self.ready: asyncio.Future[None] = owner.loop.create_future()
        """Done when calls may begin, or with the error that ended the connection before."""
        self.epoch = 0
        """Counts the changes of the server's services: method ids of another epoch may be gone."""
        self._on_advertised = on_advertised
        self._waiting: deque[CallFuture] = deque()
        self._writing_paused = False
        self._retired = False

    @property
    def is_usable(self) -> bool:
        """Whether new calls may begin here."""
        return self.is_open and self.session.last_call_id < LAST_CALL_ID

    def call(
        self,
        method: int,
        body: Body,
        decode: Callable[[Body], Any],
        deadline: float | None,
        move: Callable[[CallFuture], object] | None = None,
    ) -> CallFuture:
        """Send a request, or queue it under its deadline while the peer's limits are reached.

        Raises InvalidRequest for a body above the server's limit.
        """
        self._check_size(body)
        call = CallFuture(self, decode, deadline, method=method, body=body, move=move)
        self._begin(call)
        return call

    def take(self, call: CallFuture, method: int) -> None:
        """Send a call that another connection refused; its future stays the same."""
        if not call.done():
            self._check_size(call.body)
            call.connection, call.method = self, method
            self._begin(call)

    def resolve(
        self, question: messages.Resolve, deadline: float | None, *, definition: bool = False
    ) -> CallFuture:
        """Ask for a service (yields `Resolved`), or with an empty name for a `Listing`."""
        decode = messages.decode_resolved if question.name else messages.decode_listing
        call = CallFuture(self, decode, deadline)
        if self.is_open:
            call.call_id = self.session.resolve(call, question, definition=definition)
            self.flush_soon()
        else:
            call.failed(_lost_unsent())
        return call

    def forget(self, call: CallFuture) -> None:
        """A caller gave up."""
        if call.call_id:
            self.session.cancel(call.call_id)
            self.flush_soon()
        elif call in self._waiting:
            self._waiting.remove(call)

    def pause_writing(self) -> None:
        """The server reads slower than we call: new calls wait here, under their deadlines."""
        self._writing_paused = True

    def resume_writing(self) -> None:
        """The server has caught up."""
        self._writing_paused = False
        self._send_waiting()

    def happened(self, event: Event) -> None:
        """Hand an answer to its caller."""
        match event:
            case Answered():
                event.ticket.answered(event.body)
            case Failed():
                # Only the server itself says so: what a callback raises comes as HandlerFailed.
                gone = type(event.error) is ServiceUnavailable and event.error.not_executed
                (event.ticket.refused if gone else event.ticket.failed)(event.error)
            case Ready():
                self.handshake_over()
                if not self.ready.done():
                    self.ready.set_result(None)
            case Draining():
                for call in event.refused:
                    call.refused(refused_error())
                self.retire()
            case Advertised():
                self.epoch += 1
                self._on_advertised()
        if self._waiting:
            self._send_waiting()
        if self._retired and not self.session.in_flight:
            self.close()

    def retire(self) -> None:
        """Begin no more calls here; close once those in flight are answered."""
        self._retired = True
        self._refuse_waiting(refused_error())
        if not self.session.in_flight:
            self.close()

    def ended(self) -> None:
        """Fail what is in flight: each caller learns at once whether its call may have run."""
        reason = self.why_closed
        if not self.ready.done():
            lost = ConnectionLost("the connection was lost in the handshake", not_executed=True)
            self.ready.set_exception(reason or lost)
            self.ready.exception()  # nobody may be left to ask
        for call, error in self.session.lost():
            call.failed(error)
        self._refuse_waiting(_lost_unsent())

    def _check_size(self, body: Body) -> None:
        limit = self.session.body_limit
        if len(body) > limit:
            raise InvalidRequest("", f"a message of {len(body)} bytes; the server accepts {limit}")

    def _begin(self, call: CallFuture) -> None:
        if self._waiting or self._writing_paused or not self.session.can_send(len(call.body)):
            self._waiting.append(call)
        else:
            self._send(call)

    def _send(self, call: CallFuture) -> None:
        left = NO_DEADLINE
        if call.deadline is not None:
            seconds = call.deadline - self.owner.loop.time()
            left = max(0, min(math.ceil(seconds * 1000), NO_DEADLINE - 1))
        call.call_id = self.session.request(call, call.method, call.body, left)
        # A large request goes out at once, so that a server that does not read is noticed.
        if len(call.body) >= LARGE or (self.session.in_flight == 1 and not self._in_turn):
            self.flush()
        else:
            self.flush_soon()

    def _send_waiting(self) -> None:
        while self._waiting and not self._writing_paused:
            call = self._waiting[0]
            if not self.session.can_send(len(call.body)):
                break
            self._waiting.popleft()
            self._send(call)

    def _refuse_waiting(self, error: TaskRpcError) -> None:
        waiting, self._waiting = self._waiting, deque()
        for call in waiting:
            call.refused(error)


def _bad_answer(error: Exception) -> TaskRpcError:
    return TaskRpcError(f"the server's answer is not valid: {error}", not_executed=False)


def _lost_unsent() -> ConnectionLost:
    return ConnectionLost("the connection was lost before the call was sent", not_executed=True)
