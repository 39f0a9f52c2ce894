"""A session on an asyncio transport: reads into one shared buffer, writes once a turn."""

from __future__ import annotations

import asyncio
import logging
import math
import sys
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, cast

from taskrpc.errors import ConnectionLost, ProtocolError, TaskRpcError
from taskrpc.transport.connection.deadline_timer import Deadlines, Expiring
from taskrpc.transport.limits.keepalive import Keepalive, TcpTimeouts, drop_dead_peers
from taskrpc.transport.limits.log_throttling import LimitedLog
from taskrpc.wire.connection_state import ConnectionState
from taskrpc.wire.events import Closed, Event
from taskrpc.wire.handshake import Identity
from taskrpc.wire.session import Session

if TYPE_CHECKING:
    from taskrpc.observer import Connections

log = logging.getLogger("taskrpc.transport")

READ_BUFFER = 65_536
"""Bytes read at once; asyncio's own 256 KiB cost twice the time of a small call."""

BATCH = 16
"""Frames of one read that are handled before what they gave is written: so the peer is at work on
the first answers while the last are made, which gains half of the calls a second on two cores."""

HANDSHAKE_TIMEOUT = 3.0
STALL_PERIOD = 10.0
STALL_RATE = 1024
"""Bytes a second that a peer must move while it owes us a frame or has output to read."""
UNREAD_LIMIT = 1024 * 1024
"""Bytes of output that a peer may leave unread for long."""


class Owner(Protocol):
    """What the connections of one endpoint share."""

    loop: asyncio.AbstractEventLoop
    now: Callable[[], float]
    """The loop's clock."""
    read_buffer: memoryview
    keepalive: Keepalive
    refusals: LimitedLog
    """The log of connections that were ended for what their peers said."""
    behind: list[None]
    """One for each thing that another thread has handed to the loop, which has not done it yet."""

    def connection_began(self, connection: Any) -> None:
        """A connection has its transport."""

    def connection_ended(self, connection: Any) -> None:
        """A connection is gone."""


class Connection(asyncio.BufferedProtocol):
    """Either end of a connection; subclasses say what the events mean."""

    __slots__ = (
        "_deadlines",
        "_draining",
        "_flush_planned",
        "_gone",
        "_handshake_timer",
        "_kernel_asks",
        "_lost",
        "_read_buffer",
        "_splitter",
        "_tcp_timeouts",
        "_watch",
        "in_turn",
        "look_before",
        "owner",
        "read_at",
        "session",
        "transport",
        "why_closed",
    )

    serves: ClassVar[bool]
    """Whether requests come here: only then it matters when they were read."""
    handlers: ClassVar[dict[type[Event], Callable[[Any, Any], None]]]
    """What to do with each event: a function of this class, taking the connection and the event."""

    def __init__(
        self, owner: Owner, me: Identity, *, is_client: bool, frames_a_turn: int = sys.maxsize
    ) -> None:
        self.owner = owner
        self.session = Session(me, is_client=is_client, frames_a_turn=frames_a_turn)
        self.why_closed: TaskRpcError | None = None
        self.transport: asyncio.Transport | None = None
        self._read_buffer = owner.read_buffer
        self._splitter = self.session.splitter
        self.in_turn = False
        """Whether a read is being handled, after which all output is written at once."""
        self._flush_planned = False
        self._draining = False
        self._watch = _Watch(owner.loop.time())
        self._handshake_timer: asyncio.TimerHandle | None = None
        # Made when they are first wanted: most of thousands of idle connections need none.
        self.look_before = math.inf
        self._deadlines: Deadlines | None = None
        self._gone: asyncio.Future[None] | None = None
        self._lost = False
        self._kernel_asks = False
        """Whether the kernel asks a silent peer for a sign of life; only TCP does."""
        self._tcp_timeouts: TcpTimeouts | None = None
        """Only while the peer has not acknowledged everything."""
        self.read_at = 0.0
        """When what is being handled was read, by the loop's clock."""

    # asyncio's side

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The transport is there."""
        # Cast, not checked: uvloop's transports are no subclasses of asyncio's.
        self.transport = cast("asyncio.Transport", transport)
        if (sock := transport.get_extra_info("socket")) is not None:
            self._kernel_asks = drop_dead_peers(sock, *self.owner.keepalive)
        loop = self.owner.loop
        self._handshake_timer = loop.call_later(HANDSHAKE_TIMEOUT, self._handshake_late)
        self.owner.connection_began(self)
        self.flush()

    def get_buffer(self, sizehint: int) -> memoryview:
        """Where to read into: the shared buffer, or a large body's own."""
        large = self._splitter.large
        return self._read_buffer if large is None else large.room()

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes were read."""
        self._watch.received += nbytes
        if nbytes and self.serves:
            self.read_at = self.owner.now()
        if self._splitter.large is None:
            events = self.session.feed(self._read_buffer[:nbytes].tobytes())
        else:
            events = self.session.filled(nbytes)
        self.in_turn = True
        handlers = self.handlers
        try:
            for number, event in enumerate(events, 1):
                handlers[event.__class__](self, event)
                if not number % BATCH:
                    self.flush()
        finally:  # a callback that ends the program must not take the answers with it
            self.in_turn = False
            self.handled()
            if self._splitter.behind:
                self.read_on()

    def connection_lost(self, exc: Exception | None) -> None:
        """The transport is gone."""
        self.handshake_over()
        self.transport = None
        self._lost = True
        if self._deadlines is not None:
            self._deadlines.close()
        self.ended()
        self.owner.connection_ended(self)
        if self._gone is not None and not self._gone.done():
            self._gone.set_result(None)

    # Subclasses

    def expiring(self) -> Iterable[Expiring]:
        """The open calls, of which some may have a deadline."""
        raise NotImplementedError

    def ended(self) -> None:
        """The connection is gone; nothing more will come."""
        raise NotImplementedError

    def drained(self) -> None:
        """Something was written after GOAWAY; perhaps it was the last answer."""
        raise NotImplementedError

    def read_on(self) -> None:
        """The splitter stopped before the last frame: let it go on later."""
        raise NotImplementedError

    @property
    def unread_limit(self) -> int:
        """Bytes of output that the peer may leave unread for long."""
        return UNREAD_LIMIT

    # Our side

    def handshake_over(self) -> None:
        """The peer has proved itself, or is gone."""
        if self._handshake_timer is not None:
            self._handshake_timer.cancel()
            self._handshake_timer = None

    @property
    def gone(self) -> asyncio.Future[None]:
        """Done when the connection has ended."""
        if self._gone is None:
            self._gone = self.owner.loop.create_future()
            if self._lost:
                self._gone.set_result(None)
        return self._gone

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The event loop on which the connection lives."""
        return self.owner.loop

    @property
    def in_flight(self) -> int:
        """Calls without a response."""
        return len(self.session.open_calls)

    @property
    def peer_name(self) -> str:
        """The peer's address, for logs."""
        transport = self.transport
        return shown(None if transport is None else transport.get_extra_info("peername"))

    @property
    def received(self) -> int:
        """Bytes that came."""
        return self._watch.received

    @property
    def written(self) -> int:
        """Bytes that were written."""
        return self._watch.written

    def watch(self, deadline: float) -> None:
        """See to it that a call's deadline is looked for in time."""
        if self._deadlines is None:
            self._deadlines = Deadlines(self.owner.loop, self)
        self._deadlines.watch(deadline)

    @property
    def is_open(self) -> bool:
        """Whether calls may begin on this connection."""
        return self.session.state is ConnectionState.OPEN and self.transport is not None

    def flush(self) -> None:
        """Write what the session has to say."""
        self._flush_planned = False
        if self.session.out:
            transport = self.transport
            for piece in self.session.take():
                if transport is not None:
                    self._watch.written += len(piece)
                    transport.write(piece)
        if self._draining:
            self.drained()

    # What follows after all events of a read; subclasses may have more to do than to answer.
    handled = flush

    def count_written(self, count: int) -> None:
        """Bytes were written to the peer."""
        self._watch.written += count

    def flush_soon(self) -> None:
        """Write at the end of this turn of the loop, together with whatever else comes."""
        if not self.in_turn and not self._flush_planned:
            self._flush_planned = True
            self.owner.loop.call_soon(self.flush)

    def close(self, error: TaskRpcError | None = None) -> None:
        """End the connection after what is written."""
        self.why_closed = self.why_closed or error
        if self.transport is not None:
            self.flush()
            self.session.close()
            self.transport.close()

    def abort(self, error: TaskRpcError) -> None:
        """End the connection at once."""
        self.why_closed = self.why_closed or error
        self.session.close()
        if self.transport is not None:
            self.transport.abort()

    def tick(self, now: float) -> None:
        """Look after the connection, about once a second: silence, and peers that do not move."""
        if self.transport is None or self.session.state is ConnectionState.HANDSHAKE:
            return
        unread = self.transport.get_write_buffer_size()
        owes = self.session.mid_frame or unread > self.unread_limit
        if self._watch.stalled(now, unread, owes=owes):
            log.warning("%s moved too few bytes for %s s; cut off", self.peer_name, STALL_PERIOD)
            self.abort(ProtocolError("the peer moved too few bytes with a frame half-way"))
        # A PING of ours would start the kernel's clock anew, and a dead peer live longer.
        elif self._kernel_asks:
            if self._acknowledges_nothing(self.transport):
                self.abort(ProtocolError("the peer acknowledges nothing"))
        elif self._watch.silent(now, self.owner.keepalive.silence):
            self.session.ping(self._watch.received & 0xFFFFFFFF)
            self.flush()

    def _acknowledges_nothing(self, transport: asyncio.Transport) -> bool:
        """Whether the kernel has asked the peer in vain for room for what we have written."""
        if self._tcp_timeouts is None:
            if not self._watch.has_written():
                return False
            self._tcp_timeouts = TcpTimeouts(
                transport.get_extra_info("socket"), self.owner.keepalive
            )
        is_over = self._tcp_timeouts.is_over()
        if not self._tcp_timeouts.is_busy:
            self._tcp_timeouts = None
        return is_over

    def _closed(self, event: Closed) -> None:
        self._refuse(event.error)

    def _refuse(self, error: TaskRpcError) -> None:
        if not self.session.is_client:
            # What is noted beside it the peer is not told.
            why = "; ".join([str(error), *getattr(error, "__notes__", ())])
            text = "closed the connection from %s: %s"
            self.owner.refusals.warning(self.owner.loop.time(), text, self.peer_name, why)
        self.close(error)

    def _handshake_late(self) -> None:
        if self.session.state is ConnectionState.HANDSHAKE:
            problem = f"no handshake within {HANDSHAKE_TIMEOUT:g} s"
            if self.session.is_client:
                self._refuse(ConnectionLost(problem, not_executed=True))
            else:
                self._refuse(ProtocolError(problem))


class _Watch:
    """Counts what a connection moves, for `Connection.tick`."""

    __slots__ = (
        "_began",
        "_heard",
        "_moved_before",
        "_owed",
        "_received_before",
        "_written_before",
        "received",
        "written",
    )

    def __init__(self, now: float) -> None:
        self.received = 0
        self.written = 0
        self._began = now
        self._moved_before = 0
        self._owed = False
        self._received_before = 0
        self._written_before = 0
        self._heard = now

    def stalled(self, now: float, unread: int, *, owes: bool) -> bool:
        """Whether the peer owed us movement for a whole period and hardly moved."""
        still, self._owed = owes and self._owed, owes
        if still and now - self._began < STALL_PERIOD:
            return False
        moved = self.received + self.written - unread
        hardly = moved - self._moved_before < STALL_RATE * STALL_PERIOD
        self._moved_before = moved
        # Of the second in which the debt began only the time counts: what the system took of an
        # answer then is no sign of a peer that reads.
        if still or not owes:
            self._began = now
        return still and hardly

    def has_written(self) -> bool:
        """Whether something was written since this was asked before."""
        before, self._written_before = self._written_before, self.written
        return before != self.written

    def silent(self, now: float, seconds: float) -> bool:
        """Whether the peer has said nothing for so many seconds, so that a ping is due."""
        if self.received != self._received_before:
            self._received_before, self._heard = self.received, now
        if now - self._heard < seconds:
            return False
        self._heard = now
        return True


def shown(peer: Any) -> str:
    """An address as a socket has it, for logs."""
    return f"{peer[0]}:{peer[1]}" if isinstance(peer, tuple) else str(peer or "a peer in memory")


class Traffic:
    """One side's connections; those that are open count for themselves until they end."""

    __slots__ = ("_ended", "_opened", "_received", "_sent")

    def __init__(self) -> None:
        self._opened = self._received = self._sent = 0
        self._ended: dict[str, int] = {}

    def began(self) -> None:
        """A connection has its transport."""
        self._opened += 1

    def left(self, connection: Connection) -> None:
        """A connection is gone."""
        why = connection.why_closed
        reason = "" if why is None else type(why).__name__
        self._ended[reason] = self._ended.get(reason, 0) + 1
        self._received += connection.received
        self._sent += connection.written

    def counts(self, connections: Iterable[Connection]) -> Connections:
        """All counts, with those of the connections that are open."""
        from taskrpc.observer import Connections  # few programs ask

        now = list(connections)
        return Connections(
            self._opened,
            len(now),
            dict(self._ended),
            self._received + sum(each.received for each in now),
            self._sent + sum(each.written for each in now),
        )
