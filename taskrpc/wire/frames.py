"""Frames: a fixed 16-byte header, then the body; a splitter that finds them in a byte stream."""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag
from typing import TypeAlias

from taskrpc.errors import ProtocolError

MAGIC = b"TRPC"
"""The first bytes of every connection, before any frame."""

HEADER = struct.Struct("<IBBHII")
"""length of what follows this field, type, flags, method, call_id, arg."""

_HEADER_SIZE = HEADER.size
_AFTER_LENGTH = _HEADER_SIZE - 4
NO_DEADLINE = 0xFFFFFFFF
LARGE = 65_536
"""From this size on a body is collected in, and sent from, a buffer of its own."""


class FrameType(IntEnum):
    """What a frame is; values below 0x80 must be understood, others may be skipped."""

    HELLO = 1
    HELLO_ACK = 2
    AUTH = 3
    AUTH_OK = 4
    ADVERTISE = 5
    RESOLVE = 6
    REQUEST = 7
    RESPONSE = 8
    ERROR = 9
    CANCEL = 10
    PING = 11
    PONG = 12
    GOAWAY = 13
    SUBSCRIBE = 14
    UNSUBSCRIBE = 15
    PUBLISH = 16


FIRST_OPTIONAL_TYPE = 0x80


class Flag(IntFlag):
    """Bits of the header's flags byte."""

    EXACTLY_ONCE = 1
    NOT_EXECUTED = 2
    RETRY = 4
    FROM_HANDLER = 8


Frame: TypeAlias = tuple[int, int, int, int, int, bytes | bytearray]
"""type, flags, method, call_id, arg, body: a plain tuple, since one is made for every frame."""


def pack_frame(
    type_: int, flags: int, method: int, call_id: int, arg: int, body: bytes = b""
) -> bytes:
    """One frame as bytes."""
    return HEADER.pack(_AFTER_LENGTH + len(body), type_, flags, method, call_id, arg) + body


def pack_header(type_: int, flags: int, method: int, call_id: int, arg: int, size: int) -> bytes:
    """A frame's header alone, for a body of `size` bytes that is written separately."""
    return HEADER.pack(_AFTER_LENGTH + size, type_, flags, method, call_id, arg)


class Splitter:
    """Cuts a byte stream into frames, whatever the pieces in which it arrives.

    `limit` is the largest body that is accepted; it is checked against a frame's announced length
    before anything of the frame is kept. It may be raised after the handshake.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._tail = b""
        self._large: bytearray | None = None
        self._filled = 0

    @property
    def mid_frame(self) -> bool:
        """Whether a frame has begun and not ended."""
        return bool(self._tail) or self._large is not None

    def room(self) -> memoryview | None:
        """Where the rest of a large body may be received directly, or None.

        After writing n bytes there, call `filled(n)` instead of `feed`.
        """
        return None if self._large is None else memoryview(self._large)[self._filled :]

    def filled(self, count: int) -> list[Frame]:
        """Say that `count` bytes were written to `room()`; returns the frame once it is whole."""
        assert self._large is not None
        self._filled += count
        if self._filled < len(self._large):
            return []
        large, self._large = self._large, None
        return [(*self._large_header, large)]

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes of the stream; returns the frames that they complete.

        Raises ProtocolError for a length that no valid frame has.
        """
        if self._large is not None:
            return self._feed_large(data)
        if self._tail:
            data = self._tail + data
            self._tail = b""
        frames: list[Frame] = []
        offset, size, unpack = 0, len(data), HEADER.unpack_from
        while size - offset >= _HEADER_SIZE:
            length, type_, flags, method, call_id, arg = unpack(data, offset)
            body = offset + _HEADER_SIZE
            end = body + length - _AFTER_LENGTH
            if not 0 <= end - body <= self.limit:
                raise self._bad_length(length)
            if end > size:
                if end - body >= LARGE:
                    self._begin_large((type_, flags, method, call_id, arg), end - body, data[body:])
                    return frames
                break
            frames.append((type_, flags, method, call_id, arg, data[body:end]))
            offset = end
        self._tail = data[offset:]
        return frames

    def _begin_large(self, header: tuple[int, int, int, int, int], size: int, start: bytes) -> None:
        # The kernel gives the pages of a zeroed buffer only when they are written, so an announced
        # length alone costs the peer's victim nothing.
        self._large_header = header
        self._large = bytearray(size)
        self._large[: len(start)] = start
        self._filled = len(start)

    def _feed_large(self, data: bytes) -> list[Frame]:
        room = self.room()
        assert room is not None
        count = min(len(room), len(data))
        room[:count] = data[:count]
        room.release()
        frames = self.filled(count)
        return frames + self.feed(data[count:]) if count < len(data) else frames

    def _bad_length(self, length: int) -> ProtocolError:
        if length < _AFTER_LENGTH:
            return ProtocolError(f"a frame's length is {length}, shorter than its own header")
        return ProtocolError(
            f"a frame of {length - _AFTER_LENGTH} bytes; at most {self.limit} are accepted"
        )
