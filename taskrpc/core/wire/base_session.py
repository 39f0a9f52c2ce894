"""The part of a session below its calls: frames in and out, the handshake, and the end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from taskrpc.core.wire.connection_state import ConnectionState, StateEvent, next_state
from taskrpc.core.wire.events import Closed, Event, Ready
from taskrpc.core.wire.frames import (
    FIRST_OPTIONAL_TYPE,
    LARGE,
    MAGIC,
    Body,
    Frame,
    FrameType,
    Splitter,
    pack_frame,
    pack_header,
)
from taskrpc.core.wire.handshake import (
    ClientHandshake,
    Identity,
    Peer,
    PeerCredentials,
    ServerHandshake,
    refusal,
)
from taskrpc.core.wire.messages import DEFAULT_LIMITS
from taskrpc.errors import ProtocolError, TaskRpcError

HANDSHAKE_LIMIT = 4096
"""Bytes of a body before the peer has proved its identity."""


class BaseSession:
    """Frames and the handshake; `Session` adds calls and topics."""

    __slots__ = (
        "_head",
        "_large_out",
        "_magic_seen",
        "body_limit",
        "handshake",
        "is_client",
        "limits",
        "out",
        "splitter",
        "state",
        "their_limits",
    )

    def __init__(self, me: Identity, *, is_client: bool) -> None:
        self.state = ConnectionState.HANDSHAKE
        self.is_client = is_client
        self.handshake: ClientHandshake | ServerHandshake | None
        """None once it is done."""
        self.handshake = ClientHandshake(me) if is_client else ServerHandshake(me)
        self.limits = DEFAULT_LIMITS if is_client else me.limits
        """What this end accepts."""
        self.their_limits = DEFAULT_LIMITS
        """What the peer accepts."""
        self.body_limit = DEFAULT_LIMITS.body
        """Bytes of the largest body that the peer accepts."""
        self.splitter = Splitter(HANDSHAKE_LIMIT)
        self._magic_seen = is_client
        """Whether the peer's first bytes were valid; only a client sends MAGIC."""
        self._head = b""
        """The peer's bytes until MAGIC is complete."""
        self.out: list[Body] = []
        """Output for `take`; public, because connections check it before each write."""
        self._large_out = False
        """Whether `out` contains a large body."""
        if isinstance(self.handshake, ClientHandshake):
            self.out.append(self.handshake.start())

    def set_peer_credentials(
        self, credentials: PeerCredentials | None, channel_binding: bytes = b""
    ) -> None:
        """Set what the connection itself proves about the peer, before the first byte arrives.

        `channel_binding` identifies the connection to both ends; proofs are valid for it only.
        """
        if self.handshake is not None:
            self.handshake.peer_credentials = credentials
            self.handshake.channel_binding = channel_binding

    @property
    def mid_frame(self) -> bool:
        """Whether a frame from the peer has begun and not ended."""
        return self.splitter.mid_frame

    def handled(self, frames: Iterable[Frame]) -> Iterator[Event]:
        """Yield the events of frames that arrived after the handshake."""
        raise NotImplementedError

    def take(self) -> list[Body]:
        """Take the output for the peer, in few pieces.

        Small frames are joined. A large body stays a piece of its own: joining would copy it.
        """
        out, self.out = self.out, []
        if self._large_out:
            self._large_out = False
            return _with_small_joined(out)
        return [b"".join(out)] if out[1:] else out

    def reject(self, error: TaskRpcError) -> None:
        """Send the peer the reason, and end; nothing is read or sent afterwards."""
        if not self.is_client and self.state is not ConnectionState.CLOSED:
            self.out.append(refusal(error))
        self.advance(StateEvent.END)

    def advance(self, event: StateEvent) -> None:
        """Change the state; only the session itself calls this."""
        self.state = next_state(self.state, event)

    def close(self) -> None:
        """Read and send nothing more."""
        self.advance(StateEvent.END)

    def ping(self, nonce: int) -> None:
        """Send a PING."""
        self.send(FrameType.PING, 0, 0, 0, nonce, b"")

    def _after_magic(self, data: bytes) -> bytes:
        self._head += data
        if not MAGIC.startswith(self._head[: len(MAGIC)]):
            raise ProtocolError(
                f"the peer does not speak taskrpc: it began with {self._head[:16]!r}"
            )
        if len(self._head) < len(MAGIC):
            return b""
        self._magic_seen = True
        rest, self._head = self._head[len(MAGIC) :], b""  # an idle connection keeps no bytes
        return rest

    def feed_handshake(
        self, handshake: ClientHandshake | ServerHandshake, data: bytes
    ) -> Iterator[Event]:
        """Process the next bytes during the handshake; yield the events."""
        try:
            if not self._magic_seen:
                data = self._after_magic(data)
            yield from self._handshake_events(handshake, data)
        except TaskRpcError as error:
            yield self._closed(error)

    def _handshake_events(
        self, handshake: ClientHandshake | ServerHandshake, data: bytes
    ) -> Iterator[Event]:
        frames = self.splitter.feed(data)
        for index, frame in enumerate(frames):
            if frame[0] < FIRST_OPTIONAL_TYPE:
                reply = handshake.receive(frame)
                if reply:
                    self.out.append(reply)
            if handshake.peer is not None:
                ready = self._open(handshake.peer)
                # Now the splitter can cut the bytes that exceeded the handshake's smaller limit.
                rest = frames[index + 1 :] + self.splitter.feed(b"")
                yield ready
                yield from self.handled(rest)
                return
        if self.splitter.error is not None:
            raise self.splitter.error

    def _open(self, peer: Peer) -> Ready:
        self.advance(StateEvent.HANDSHAKE_DONE)
        self.handshake = None
        self.their_limits = peer.limits
        self.body_limit = peer.limits.body
        self.splitter.limit = self.limits.body
        return Ready(peer)

    def _closed(self, error: TaskRpcError) -> Closed:
        if self._magic_seen:
            self.reject(error)
        self.advance(StateEvent.END)
        # The traceback would keep stack frames alive, and with them the peer's data.
        return Closed(error.with_traceback(None))

    def send(self, type_: int, flags: int, method: int, call_id: int, arg: int, body: Body) -> None:
        """Send a frame of any type."""
        if self.state is ConnectionState.CLOSED:
            return
        size = len(body)
        if size < LARGE:
            self.out.append(pack_frame(type_, flags, method, call_id, arg, body))
        else:
            self.out += pack_header(type_, flags, method, call_id, arg, size), body
            self._large_out = True


def _with_small_joined(out: list[Body]) -> list[Body]:
    pieces: list[Body] = []
    small: list[Body] = []
    for piece in out:
        if len(piece) < LARGE:
            small.append(piece)
        else:
            pieces += b"".join(small), piece
            small.clear()
    if small:
        pieces.append(b"".join(small))
    return pieces
