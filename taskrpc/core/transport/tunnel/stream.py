"""One end of a connection over datagrams: order, flow control and the end. Pure.

The owner passes in what the protocol writes (`write`, `close`, `reset`) and the datagrams that
arrive (`feed`), and sends all of `out` after each of these calls. Nothing is sent twice: if a
datagram is missing, the connection is reset, and taskrpc connects again.

Flow control: each end says up to which byte it is ready to receive. The limit is `WINDOW` bytes
ahead of the bytes that its program has read, so a program never keeps more than `WINDOW` unread
bytes of a connection. Each DATA carries the limit; without DATA to send, a CREDIT carries it.
"""

from __future__ import annotations

from collections import deque
from enum import Enum

from taskrpc.core.transport.tunnel.frames import MAX_DATA, Datagram, Kind, pack, pack_reset

WINDOW = 1024 * 1024
"""Unread bytes that one end accepts."""
_NUMBERS = 2**32
"""The numbers of datagrams begin again at 0 after this many."""


class State(Enum):
    """The state of one end."""

    OPEN = "open"
    CLOSING = "closing"
    """No more is written; FIN follows the bytes that wait for credit."""
    FINISHED = "finished"
    """FIN was sent."""
    RESET = "reset"
    """One of the ends has reset the connection."""


class Stream:
    """One end of a connection; `peer` is the id that the other end has chosen."""

    __slots__ = (
        "_expected",
        "_limit",
        "_number",
        "_promised",
        "_read",
        "_received",
        "_sent",
        "_waiting",
        "_window",
        "ended",
        "out",
        "peer",
        "state",
        "waiting_size",
    )

    def __init__(self, peer: int, limit: int, window: int = WINDOW) -> None:
        self.peer = peer
        self.state = State.OPEN
        self.out: list[bytes] = []
        """The datagrams to send now; the owner empties it."""
        self.ended = False
        """Whether the other end has sent everything, and all of it has arrived."""
        self.waiting_size = 0
        """Bytes that wait for credit."""
        self._waiting: deque[memoryview] = deque()
        self._number = 0
        """The number of the next datagram to send."""
        self._sent = 0
        self._limit = limit
        """How many bytes the other end is ready to receive, counted from the start."""
        self._window = window
        self._expected = 0
        """The number of the next datagram to arrive."""
        self._received = 0
        self._read = 0
        self._promised = window
        """The last limit that this end has sent to the other one."""

    # The program's side

    def write(self, data: bytes) -> None:
        """Send bytes: at once if the other end is ready for them, else later."""
        if self.state is not State.OPEN:
            return
        size = len(data)
        if not self._waiting and size <= MAX_DATA and self._sent + size <= self._limit:
            self._send(data)
        elif data:
            self._waiting.append(memoryview(bytes(data)))
            self.waiting_size += size
            self._send_waiting()

    def close(self) -> None:
        """Write no more; the other end gets everything that was written, and then FIN."""
        if self.state is State.OPEN:
            self.state = State.CLOSING
            self._send_waiting()

    def reset(self, reason: str) -> None:
        """End the connection at once; bytes that wait are lost."""
        if self.state is not State.RESET:
            self._break()
            self.out.append(pack_reset(self.peer, reason))

    def read(self, count: int) -> None:
        """Note that the program has read this many bytes: the other end may send more."""
        self._read += count
        # Half a window at a time: a CREDIT for each read would double the number of datagrams.
        # In a call, the DATA of the response carries the limit, and no CREDIT is needed.
        if (
            self._read + self._window - self._promised >= self._window // 2
            and self.state is not State.RESET
            and not self.ended
        ):
            self._promised = self._read + self._window
            self.out.append(pack(Kind.CREDIT, self.peer, 0, self._promised))

    # The network's side

    def feed(self, datagram: Datagram) -> memoryview | None:
        """Handle a datagram; return the bytes that it brings for the program, if any."""
        kind, _, number, limit, data = datagram
        if self.state is State.RESET or self.ended:
            return None  # after FIN, the program may still read what has arrived
        if kind == Kind.RST:
            self._break()
            return None
        if limit > self._limit:
            self._limit = limit
            if self._waiting:
                self._send_waiting()
        if kind != Kind.DATA or number != self._expected:
            if kind in (Kind.DATA, Kind.FIN):
                self._feed_end_or_gap(number)
            return None
        self._expected = (number + 1) % _NUMBERS
        self._received += len(data)
        if self._received <= self._promised:
            return data
        self.reset("more bytes than the window allows")
        return None

    def _feed_end_or_gap(self, number: int) -> None:
        """Handle a FIN, or a DATA that is not the next one."""
        ahead = (number - self._expected) % _NUMBERS
        if not ahead:
            self.ended = True
        elif (
            ahead < _NUMBERS // 2
        ):  # A number far ahead belongs to a repeated datagram, which does no harm.
            self.reset("a datagram is missing")

    def _send(self, data: bytes | memoryview) -> None:
        self._promised = self._read + self._window
        header = pack(Kind.DATA, self.peer, self._number, self._promised)
        self._number = (self._number + 1) % _NUMBERS
        self._sent += len(data)
        self.out.append(b"".join((header, data)))

    def _send_waiting(self) -> None:
        """Send the waiting bytes that the other end is ready for; then FIN after a `close`."""
        while self._waiting and (room := self._limit - self._sent) > 0:
            data = self._waiting.popleft()
            count = min(len(data), room, MAX_DATA)
            if count < len(data):
                self._waiting.appendleft(data[count:])
            self.waiting_size -= count
            self._send(data[:count])
        if self.state is State.CLOSING and not self._waiting:
            self.state = State.FINISHED
            self.out.append(pack(Kind.FIN, self.peer, self._number, self._promised))

    def _break(self) -> None:
        self.state = State.RESET
        self._waiting.clear()
        self.waiting_size = 0
