"""The client side of a connection: calls as futures, queued at the server's limits."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Any, ClassVar, Protocol

import msgspec

from taskrpc.core.request_ids.ids import RequestCounter
from taskrpc.core.transport.base import end_program
from taskrpc.core.transport.connection.connection import Connection, Owner
from taskrpc.core.transport.connection.deadline_timer import CHECK_LATE, TICK
from taskrpc.core.wire import messages
from taskrpc.core.wire.events import (
    Closed,
    Draining,
    ErrorReceived,
    MessageReceived,
    PublishersReceived,
    Ready,
    ResponseReceived,
    ServicesChanged,
)
from taskrpc.core.wire.frames import HEADER, LARGE, NO_DEADLINE, Body
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.session import LAST_CALL_ID, Session, refused_error, unknown_error
from taskrpc.errors import (
    ConnectionLost,
    DeadlineExceeded,
    InvalidRequest,
    ProtocolError,
    ServiceUnavailable,
    TaskRpcError,
)

HANDSHAKE_LOST = "the connection was lost in the handshake"

_ROUNDING = 1e-6
"""Milliseconds by which the difference of two instants may be too large."""

_callbacks_of = attrgetter("_callbacks")
"""What asyncio is going to call at the end of a future: a list of functions, each with its context;
None if there are none."""

MAX_MOVES = 8
"""How often one call may be refused and moved to another server before it fails."""


class OpenCall(msgspec.Struct, eq=False):
    """A call of this process, from queueing or sending to its response."""

    future: Any
    """Gets the decoded response or the error: an asyncio.Future, or a `Waiter` for a thread."""
    connection: CallingConnection
    decode: Callable[[Body], Any]
    deadline: float | None
    """On the event loop's clock; None for none."""
    method: int = 0
    """The server's method id; 0 for a RESOLVE."""
    body: Body = b""
    move: Callable[[OpenCall], object] | None = None
    """Sends the call to another server, if the first one certainly did not begin it."""
    flags: int = 0
    call_id: int = 0
    """0 until the request is sent."""
    moves: int = 0
    counter: RequestCounter | None = None
    """The counter that gave it the sequence number, None if the channel took none."""
    sequence: int = 0
    is_late: bool = False
    """Whether the deadline has passed and the client waits to hear whether the call had begun."""

    def answered(self, body: Body) -> None:
        """Complete the call with the body of its response."""
        try:
            self.future.set_result(self.decode(body))
        except (InvalidRequest, ProtocolError) as error:
            self.failed(_bad_answer(error))
        except asyncio.InvalidStateError:
            pass  # cancelled in this turn of the event loop

    def failed(self, error: BaseException) -> None:
        """End the call with an error."""
        if not self.future.done():
            # An error of the handler is a response, even just after the deadline.
            if isinstance(error, TaskRpcError) and self.is_late and error.not_executed is not False:
                error = _deadline_exceeded(error.not_executed)
            self.future.set_exception(error)

    def refused(self, error: TaskRpcError) -> None:
        """Send the call to another server, or fail it: this server certainly did not begin it."""
        if self.move is None or self.is_late or self.moves >= MAX_MOVES:
            self.failed(error)
        elif not self.future.done():
            self.moves += 1
            self.call_id = 0
            self.move(self)

    def expired(self) -> None:
        """Cancel the call after its deadline, and give the caller its outcome.

        Only the server knows whether a sent call has begun. The client waits for its answer during
        the rest of the tick by which an expired call may end late.
        """
        if self.is_late or self.future.done():
            return
        if self.call_id and self.method:
            self.connection.forget(self, await_outcome=True)
            self.is_late = True
            # From now, not from the deadline: a late event loop has not read the answer yet.
            self.connection.owner.loop.call_later(TICK - CHECK_LATE, self._outcome_unknown)
        else:  # not sent, or a RESOLVE: nothing can have run
            self.future.set_exception(_deadline_exceeded(not_executed=True))
            self.connection.forget(self)

    def _outcome_unknown(self) -> None:
        """End the call: the server did not say in time whether it had begun."""
        if not self.future.done():
            self.future.set_exception(_deadline_exceeded(not_executed=None))
            self.connection.forget(self)

    def cancel(self, future: asyncio.Future[Any] | None = None) -> None:
        """Cancel the call at the server if the caller's future was cancelled."""
        if self.future.cancelled():
            self.connection.forget(self)


class TopicEvents(Protocol):
    """Receives what the server sends for our subscriptions."""

    def publishers_received(self, event: PublishersReceived) -> None:
        """The server listed the publishers of a subscription's topic."""

    def published(self, event: MessageReceived, read: int) -> None:
        """A message arrived; messages of one read have the same number `read`."""


class CallingConnection(Connection):
    """A connection on which this process calls; shared by all channels to one server."""

    __slots__ = (
        "_on_advertised",
        "_retired",
        "_waiting",
        "_writing_paused",
        "epoch",
        "link",
        "peer_id",
        "ready",
    )

    def __init__(
        self, owner: Owner, me: Identity, on_advertised: Callable[[], object] = lambda: None
    ) -> None:
        super().__init__(owner, me, is_client=True)
        self.ready: asyncio.Future[None] = owner.loop.create_future()
        """Done when calls may begin; has an error if the connection ended before."""
        self.epoch = 0
        """Increases when method ids become stale: when the server's services change, and when this
        connection takes no new calls. A channel compares this one number before each call."""
        self.link: TopicEvents | None = None
        """Receives the messages of our subscriptions."""
        self.peer_id = b""
        """Identifies the server's program; new at each of its starts."""
        self._on_advertised = on_advertised
        """Called when the server's services change."""
        self._waiting: deque[OpenCall] = deque()
        """Calls that exceed the server's limits; sent later, in order."""
        self._writing_paused = False
        """Whether the server reads more slowly than we write."""
        self._retired = False
        """Whether the connection takes no new calls, and closes after the last response."""

    @property
    def is_usable(self) -> bool:
        """Whether new calls may begin here."""
        return self.is_open and self.session.last_call_id < LAST_CALL_ID

    def begin(self, call: OpenCall, left: int = 0) -> None:  # noqa: PLR0912 (runs for each call)
        """Send a call, or queue it under its deadline while the peer's limits are reached.

        `left` is the milliseconds until the deadline, if the caller has just computed them.
        Raises InvalidRequest for a body above the server's limit.
        """
        body, deadline, session = call.body, call.deadline, self.session
        size = len(body)
        if size > session.body_limit:
            limit = session.body_limit
            raise InvalidRequest("", f"a message of {size} bytes; the server accepts {limit}")
        if deadline is None:
            left = NO_DEADLINE
        else:
            if deadline < self.check_before:
                self.watch(deadline)
            if not left:
                left = time_left(deadline, self.owner.now())
        if self._waiting or self._writing_paused:
            self._waiting.append(call)
            return
        if left <= 0 or size >= LARGE:
            if not self._send(call):
                self._waiting.append(call)
            return
        # The same as `_send`, with a third of its function calls: it writes without `flush`.
        is_first = not session.open_calls
        at_once = is_first and self.writes_at_once and not (session.out or self.in_turn)
        frame = session.request_frame(call, call.method, body, left, call.flags, size)
        if not frame:
            self._waiting.append(call)
            return
        call.call_id = call_id = session.last_call_id
        if call_id >= LAST_CALL_ID:
            self.epoch += 1
        if at_once and self.transport is not None:
            self._watch.written += HEADER.size + size
            self.transport.write(frame)
        else:
            session.out.append(frame)
            if not self.in_turn and (is_first or not self._flush_planned):
                self._flush_request(size)

    def resolve(
        self, question: messages.Resolve, deadline: float | None, *, definition: bool = False
    ) -> OpenCall:
        """Ask for a service (gives `Resolved`); see `Resolve` for the names of other questions."""
        decode = _other_response(question.name) or messages.decode_resolved
        call = OpenCall(self.owner.loop.create_future(), self, decode, deadline)
        if self.is_open:
            if deadline is not None and deadline < self.check_before:
                self.watch(deadline)
            call.call_id = self.session.resolve(call, question, definition=definition)
            self.flush_soon()
        else:
            call.failed(_lost_unsent())
        return call

    def say(self, action: Callable[[Session], object]) -> None:
        """Let `action` send frames other than those of a call."""
        if self.transport is not None:
            action(self.session)
            self.flush_soon()

    def forget(self, call: OpenCall, *, await_outcome: bool = False) -> None:
        """Cancel a call; with `await_outcome`, the server's answer still reaches it."""
        if call.call_id:
            if await_outcome:
                self.session.ask_to_stop(call.call_id)
            elif call.is_late:  # it was cancelled before
                self.session.drop(call.call_id)
            else:
                self.session.cancel(call.call_id)
            self.flush_soon()
        elif call in self._waiting:
            self._waiting.remove(call)

    def pause_writing(self) -> None:
        """Queue new calls under their deadlines: the server reads more slowly than we call."""
        self._writing_paused = True
        self.session.answer_pings(wanted=False)

    def resume_writing(self) -> None:
        """Send the queued calls: the server has read what was written."""
        self._writing_paused = False
        self.session.answer_pings(wanted=True)
        self._send_waiting()

    def expiring(self) -> Iterable[OpenCall]:
        """The calls that wait for a response, and those that wait to be sent."""
        return [*self.session.open_tickets(), *self._waiting]

    def buffer_updated(self, nbytes: int) -> None:
        """Handle bytes that asyncio has read: complete calls, then send those that wait."""
        self._watch.received += nbytes
        session, self.in_turn = self.session, True
        try:
            if self._splitter.large is None:
                data = self._read_buffer[:nbytes].tobytes()
                found, rest = session.responses(data, nbytes)
                # What several callers send now is written together; one caller writes at once.
                self.in_turn = bool(rest or found[1:])
                for call, body in found:
                    future = call.future
                    try:  # as in `answered`
                        message = call.decode(body)
                        if (
                            future.__class__ is asyncio.Future
                            and self.resumes_at_once
                            and (waiting := _callbacks_of(future))
                            and not waiting[1:]
                        ):
                            # asyncio would resume the caller in the next turn of the event loop,
                            # which costs a tenth of the call, a quarter if it is the only one.
                            ((resume, context),) = waiting
                            future.remove_done_callback(resume)
                            future.set_result(message)
                            context.run(resume, future)
                        else:
                            future.set_result(message)
                    except (InvalidRequest, ProtocolError, asyncio.InvalidStateError):
                        call.answered(body)  # decoded again, to report the error
                    except (SystemExit, KeyboardInterrupt) as error:
                        self.owner.loop.call_soon(end_program, error)
                if rest:
                    self.handle(session.feed(rest))
            else:
                self.handle(session.filled(nbytes))
        finally:
            self.in_turn = False
            if self._waiting:
                self._send_waiting()
            if self._retired and not session.open_calls:
                self.close()
            if session.out:
                self.flush()

    def _answered(self, event: ResponseReceived) -> None:
        event.ticket.answered(event.body)

    def _failed(self, event: ErrorReceived) -> None:
        # Sent only by the server itself: an exception of a handler arrives as HandlerFailed.
        gone = type(event.error) is ServiceUnavailable and event.error.not_executed
        (event.ticket.refused if gone else event.ticket.failed)(event.error)

    def _opened(self, event: Ready) -> None:
        self.handshake_over()
        self.peer_id = event.peer.id
        if not self.ready.done():
            self.ready.set_result(None)

    def _drained(self, event: Draining) -> None:
        for call in event.refused:
            call.refused(refused_error())
        self.retire()

    def _advertised(self, event: ServicesChanged) -> None:
        self.epoch += 1
        self._on_advertised()

    def _publishers_received(self, event: PublishersReceived) -> None:
        if self.link is not None:
            self.link.publishers_received(event)

    def _published(self, event: MessageReceived) -> None:
        if self.link is not None:
            self.link.published(event, self.received)

    serves = False
    writes_at_once: ClassVar = True
    """Whether a request may be written without `flush`."""
    resumes_at_once: ClassVar = True
    """Whether a caller continues while the read that has its response is handled."""
    handlers: ClassVar = {
        ResponseReceived: _answered,
        ErrorReceived: _failed,
        MessageReceived: _published,
        PublishersReceived: _publishers_received,
        Ready: _opened,
        Draining: _drained,
        ServicesChanged: _advertised,
        Closed: Connection._closed,
    }

    def close(self, error: TaskRpcError | None = None) -> None:
        """End the connection after what is written."""
        self.epoch += 1
        super().close(error)

    def abort(self, error: TaskRpcError) -> None:
        """End the connection at once."""
        self.epoch += 1
        super().abort(error)

    def retire(self) -> None:
        """Begin no more calls here; close after the last response."""
        self.epoch += 1
        self._retired = True
        self._refuse_waiting(refused_error())
        if not self.session.in_flight:
            self.close()

    def ended(self) -> None:
        """Fail the calls in flight; each error says whether the call may have run."""
        self.epoch += 1
        reason = self.why_closed
        if not self.ready.done():
            lost = ConnectionLost(HANDSHAKE_LOST, not_executed=True)
            self.ready.set_exception(reason or lost)
            self.ready.exception()  # otherwise asyncio reports it as never retrieved
        for call in self.session.lost():
            call.failed(unknown_error())
        self._refuse_waiting(_lost_unsent())

    def _send(self, call: OpenCall) -> bool:
        """Send a call, or expire it if its deadline has passed; False if the limits are reached."""
        session, body, left = self.session, call.body, NO_DEADLINE
        if call.deadline is not None:
            left = time_left(call.deadline, self.owner.now())
            if left <= 0:
                call.expired()
                return True
        call_id = session.request(call, call.method, body, left, call.flags)
        if not call_id:
            return False
        call.call_id = call_id
        if call_id >= LAST_CALL_ID:
            self.epoch += 1
        self._flush_request(len(body))
        return True

    def _flush_request(self, size: int) -> None:
        # A large request is written at once, so that a server that does not read is noticed.
        if (len(self.session.open_calls) == 1 and not self.in_turn) or size >= LARGE:
            self.flush()
        elif not self._flush_planned:
            self.flush_soon()

    def _send_waiting(self) -> None:
        while self._waiting and not self._writing_paused:
            call = self._waiting.popleft()
            if not call.future.done() and not self._send(call):
                self._waiting.appendleft(call)
                break

    def _refuse_waiting(self, error: TaskRpcError) -> None:
        waiting, self._waiting = self._waiting, deque()
        for call in waiting:
            call.refused(error)


def time_left(deadline: float, now: float) -> int:
    """Milliseconds until a deadline, rounded up; 0 or less once it has passed."""
    left = math.ceil((deadline - now) * 1000 - _ROUNDING)
    return left if left < NO_DEADLINE else NO_DEADLINE - 1


def _deadline_exceeded(not_executed: bool | None) -> DeadlineExceeded:
    return DeadlineExceeded("no response by the deadline", not_executed=not_executed)


def _bad_answer(error: Exception) -> TaskRpcError:
    return TaskRpcError(f"the server's answer is not valid: {error}", not_executed=False)


def _lost_unsent() -> ConnectionLost:
    return ConnectionLost("the connection was lost before the call was sent", not_executed=True)


def _other_response(name: str) -> Callable[[Body], Any] | None:
    """Return the decoder for a RESOLVE that does not ask for a service; None if it does."""
    if not name:
        return messages.decode_listing
    if name != messages.STATISTICS:
        return None
    from taskrpc.core.wire.statistics import decode_statistics  # only `taskrpc top` needs it

    return decode_statistics
