"""A session on an asyncio transport: reads into one shared buffer, writes once per loop turn."""

from __future__ import annotations

import asyncio
import logging
import math
import sys
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, cast

from taskrpc.core.transport.connection.deadline_timer import Deadlines, Expiring
from taskrpc.core.transport.limits.keepalive import Keepalive, TcpTimeouts, drop_dead_peers
from taskrpc.core.transport.limits.log_throttling import LimitedLog
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import Closed, Event
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.session import Session
from taskrpc.errors import ConnectionLost, ProtocolError, TaskRpcError

if TYPE_CHECKING:
    from taskrpc.core.observer import Connections

log = logging.getLogger("taskrpc.transport")

READ_BUFFER = 65_536
"""Bytes read at once; asyncio's own 256 KiB cost twice the time of a small call."""

BATCH = 16
"""Frames of one read that are handled before the output is written. So the peer can work on the
first responses while this process makes the last ones: on two cores, 50 % more calls a second."""

HANDSHAKE_TIMEOUT = 3.0
"""Seconds."""
STALL_PERIOD = 10.0
"""Seconds over which `STALL_RATE` is measured."""
STALL_RATE = 1024
"""Bytes a second that a peer must move while a frame of it is incomplete or output is unread."""
UNREAD_LIMIT = 1024 * 1024
"""Bytes of output that a peer may leave unread for a long time."""


class Owner(Protocol):
    """What the connections of one endpoint share."""

    loop: asyncio.AbstractEventLoop
    now: Callable[[], float]
    """The loop's clock."""
    read_buffer: memoryview
    """Receives the bytes of every read; a connection handles them before the next read."""
    keepalive: Keepalive
    """When to close the connection of a silent peer."""
    refusals: LimitedLog
    """Logs the connections that were closed because of what the peer sent."""
    behind: list[None]
    """One item for each pending action that another thread has handed to the event loop."""

    def connection_began(self, connection: Any) -> None:
        """Count a connection that has its transport."""

    def connection_ended(self, connection: Any) -> None:
        """Count a connection that is gone."""


class Connection(asyncio.BufferedProtocol):
    """Either end of a connection; subclasses handle the events."""

    __slots__ = (
        "_deadlines",
        "_draining",
        "_flush_planned",
        "_gone",
        "_handshake_timer",
        "_kernel_probes",
        "_lost",
        "_read_buffer",
        "_splitter",
        "_tcp_timeouts",
        "_watch",
        "check_before",
        "in_turn",
        "owner",
        "read_at",
        "session",
        "transport",
        "why_closed",
    )

    serves: ClassVar[bool]
    """Whether this is the server side; only there the time of a read matters."""
    handlers: ClassVar[dict[type[Event], Callable[[Any, Any], None]]]
    """The handler of each event, a function that takes the connection and the event."""

    def __init__(
        self, owner: Owner, me: Identity, *, is_client: bool, frames_a_turn: int = sys.maxsize
    ) -> None:
        self.owner = owner
        self.session = Session(me, is_client=is_client, frames_a_turn=frames_a_turn)
        self.why_closed: TaskRpcError | None = None
        """The error that closed the connection; None if it closed normally or is open."""
        self.transport: asyncio.Transport | None = None
        """None before the connection is made, and after it is gone."""
        self._read_buffer = owner.read_buffer
        self._splitter = self.session.splitter
        self.in_turn = False
        """Whether a read is being handled; its output is written together at the end."""
        self._flush_planned = False
        self._draining = False
        """Whether GOAWAY was sent: the connection closes after the last response."""
        self._watch = _Watch(owner.loop.time())
        self._handshake_timer: asyncio.TimerHandle | None = None
        # Created when first needed: of thousands of idle connections, most need none of these.
        self.check_before = math.inf
        """A call with an earlier deadline must pass it to `watch`."""
        self._deadlines: Deadlines | None = None
        self._gone: asyncio.Future[None] | None = None
        self._lost = False
        self._kernel_probes = False
        """Whether the kernel probes a silent peer; only TCP does."""
        self._tcp_timeouts: TcpTimeouts | None = None
        """Set only while written bytes are unacknowledged."""
        self.read_at = 0.0
        """When the bytes that are being handled were read, on the event loop's clock."""

    # Called by asyncio

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin: asyncio has connected the transport."""
        # Cast, not checked: uvloop's transports are no subclasses of asyncio's.
        self.transport = cast("asyncio.Transport", transport)
        if (sock := transport.get_extra_info("socket")) is not None:
            self._kernel_probes = drop_dead_peers(sock, *self.owner.keepalive)
        loop = self.owner.loop
        self._handshake_timer = loop.call_later(HANDSHAKE_TIMEOUT, self._handshake_late)
        self.owner.connection_began(self)
        self.flush()

    def get_buffer(self, sizehint: int) -> memoryview:
        """Where to read into: the shared buffer, or a large body's own."""
        large = self._splitter.large
        return self._read_buffer if large is None else large.room()

    def buffer_updated(self, nbytes: int) -> None:
        """Handle bytes that asyncio has read into the buffer."""
        raise NotImplementedError

    def connection_lost(self, exc: Exception | None) -> None:
        """End: the transport is closed."""
        self.handshake_over()
        self.transport = None
        self._lost = True
        if self._deadlines is not None:
            self._deadlines.close()
        self.ended()
        self.owner.connection_ended(self)
        if self._gone is not None and not self._gone.done():
            self._gone.set_result(None)

    # For subclasses

    def handle(self, events: Iterable[Event]) -> None:
        """Handle events, and write the output from time to time."""
        handlers = self.handlers
        for number, event in enumerate(events, 1):
            handlers[event.__class__](self, event)
            if not number % BATCH:
                self.flush()

    def expiring(self) -> Iterable[Expiring]:
        """The open calls, of which some may have a deadline."""
        raise NotImplementedError

    def ended(self) -> None:
        """Clean up: the connection is gone."""
        raise NotImplementedError

    def drained(self) -> None:
        """Output was written after GOAWAY; it may have been the last response."""
        raise NotImplementedError

    def read_on(self) -> None:
        """Handle the remaining frames later: the splitter stopped before the last one."""
        raise NotImplementedError

    @property
    def unread_limit(self) -> int:
        """Bytes of output that the peer may leave unread for a long time."""
        return UNREAD_LIMIT

    # Called by this process

    def handshake_over(self) -> None:
        """Stop the handshake's timer: the peer has proved its identity, or is gone."""
        if self._handshake_timer is not None:
            self._handshake_timer.cancel()
            self._handshake_timer = None

    @property
    def gone(self) -> asyncio.Future[None]:
        """A future that is done when the connection has ended."""
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
        """The number of calls without a response."""
        return len(self.session.open_calls)

    @property
    def peer_name(self) -> str:
        """The peer's address, for logs."""
        transport = self.transport
        return shown(None if transport is None else transport.get_extra_info("peername"))

    @property
    def received(self) -> int:
        """Bytes that were received."""
        return self._watch.received

    @property
    def written(self) -> int:
        """Bytes that were written."""
        return self._watch.written

    def watch(self, deadline: float) -> None:
        """Check the open calls when this deadline passes."""
        if self._deadlines is None:
            self._deadlines = Deadlines(self.owner.loop, self)
        self._deadlines.watch(deadline)

    @property
    def is_open(self) -> bool:
        """Whether calls may begin on this connection."""
        return self.session.state is ConnectionState.OPEN and self.transport is not None

    def flush(self) -> None:
        """Write the session's output."""
        self._flush_planned = False
        session = self.session
        if out := session.out:
            if out[1:]:
                out = session.take()
            else:  # a large body is never alone: its header is the piece before it
                session.out = []
            transport = self.transport
            for piece in out:
                if transport is not None:
                    self._watch.written += len(piece)
                    transport.write(piece)
        if self._draining:
            self.drained()

    def count_written(self, count: int) -> None:
        """Count bytes that were written to the peer."""
        self._watch.written += count

    def flush_soon(self) -> None:
        """Write at the end of this turn of the event loop, together with other output."""
        if not self.in_turn and not self._flush_planned:
            self._flush_planned = True
            self.owner.loop.call_soon(self.flush)

    def close(self, error: TaskRpcError | None = None) -> None:
        """Close the connection after its output is written."""
        self.why_closed = self.why_closed or error
        if self.transport is not None:
            self.flush()
            self.session.close()
            self.transport.close()

    def abort(self, error: TaskRpcError) -> None:
        """Close the connection at once."""
        self.why_closed = self.why_closed or error
        self.session.close()
        if self.transport is not None:
            self.transport.abort()

    def tick(self, now: float) -> None:
        """Check for silent and stalled peers, about once a second."""
        if self.transport is None or self.session.state is ConnectionState.HANDSHAKE:
            return
        unread = self.transport.get_write_buffer_size()
        owes = self.session.mid_frame or unread > self.unread_limit
        if self._watch.stalled(now, unread, owes=owes):
            log.warning(
                "%s moved too few bytes for %s s; closed its connection",
                self.peer_name,
                STALL_PERIOD,
            )
            self.abort(ProtocolError("the peer sends or reads too slowly"))
        # A PING would restart the kernel's timer, and a dead peer would be found later.
        elif self._kernel_probes:
            if self._acknowledges_nothing(self.transport):
                self.abort(ProtocolError("the peer did not acknowledge our output in time"))
        elif self._watch.silent(now, self.owner.keepalive.silence):
            self.session.ping(self._watch.received & 0xFFFFFFFF)
            self.flush()

    def _acknowledges_nothing(self, transport: asyncio.Transport) -> bool:
        """Whether the peer has not acknowledged our output for too long."""
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
            # Notes go to our log only; the peer does not see them.
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
    """Counts the bytes of a connection, for `Connection.tick`."""

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
        """When the present period of `stalled` began."""
        self._moved_before = 0
        """Bytes that the peer had moved when it began."""
        self._owed = False
        """Whether a frame was incomplete, or output unread, at the last check."""
        self._received_before = 0
        self._written_before = 0
        self._heard = now
        """When the peer last sent bytes, or a PING was due."""

    def stalled(self, now: float, unread: int, *, owes: bool) -> bool:
        """Whether the peer moved too few bytes for a whole period in which it `owes` some."""
        still, self._owed = owes and self._owed, owes
        if still and now - self._began < STALL_PERIOD:
            return False
        moved = self.received + self.written - unread
        hardly = moved - self._moved_before < STALL_RATE * STALL_PERIOD
        self._moved_before = moved
        # Bytes of the first second do not count: the kernel buffered them, whether or not the peer
        # reads.
        if still or not owes:
            self._began = now
        return still and hardly

    def has_written(self) -> bool:
        """Whether bytes were written since the last check."""
        before, self._written_before = self._written_before, self.written
        return before != self.written

    def silent(self, now: float, seconds: float) -> bool:
        """Whether a PING is due: the peer has sent nothing for so many seconds."""
        if self.received != self._received_before:
            self._received_before, self._heard = self.received, now
        if now - self._heard < seconds:
            return False
        self._heard = now
        return True


def shown(peer: Any) -> str:
    """A socket address, for logs."""
    return f"{peer[0]}:{peer[1]}" if isinstance(peer, tuple) else str(peer or "a peer in memory")


class Traffic:
    """Counters of one side's connections; open connections add their own until they end."""

    __slots__ = ("_ended", "_opened", "_received", "_sent")

    def __init__(self) -> None:
        self._opened = self._received = self._sent = 0
        self._ended: dict[str, int] = {}

    def began(self) -> None:
        """Count a connection that has its transport."""
        self._opened += 1

    def left(self, connection: Connection) -> None:
        """Count a connection that is gone."""
        why = connection.why_closed
        reason = "" if why is None else type(why).__name__
        self._ended[reason] = self._ended.get(reason, 0) + 1
        self._received += connection.received
        self._sent += connection.written

    def counts(self, connections: Iterable[Connection]) -> Connections:
        """All counts, with those of the connections that are open."""
        from taskrpc.core.observer import Connections  # few programs need it

        now = list(connections)
        return Connections(
            self._opened,
            len(now),
            dict(self._ended),
            self._received + sum(each.received for each in now),
            self._sent + sum(each.written for each in now),
        )
