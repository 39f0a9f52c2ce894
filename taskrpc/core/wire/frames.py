"""Frames: a fixed 16-byte header, then the body; a splitter that finds them in a byte stream."""

from __future__ import annotations

import struct
import sys
from enum import IntEnum, IntFlag
from typing import TypeAlias

from taskrpc.errors import ProtocolError

MAGIC = b"TRPC"
"""The first bytes of every connection, before any frame."""

HEADER = struct.Struct("<IBBHII")
"""length, type, flags, method, call_id, arg; the length counts all bytes behind itself."""

_LENGTH_SIZE = 4
SIZE_OF_EMPTY = HEADER.size - _LENGTH_SIZE
"""The length field of a frame without a body."""
_HEADER_SIZE = HEADER.size
_unpack = HEADER.unpack_from
NO_DEADLINE = 0xFFFFFFFF
"""The `arg` of a request without a deadline."""
LARGE = 65_536
"""Bytes from which a body is received into a buffer of its own, and sent without being copied."""
GROWTH = 4
"""The factor by which a full buffer of a large body grows; each time its bytes are copied once."""


class FrameType(IntEnum):
    """The type of a frame; a receiver must know values below 0x80, and skips unknown others.

    0xFF is reserved; see `SKIPPED`.
    """

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
SKIPPED = 0xFF
"""The type that a session gives to a large frame that it skips; no protocol may use it."""


class Flag(IntFlag):
    """Bits of the header's flags byte."""

    EXACTLY_ONCE = 1
    NOT_EXECUTED = 2
    RETRY = 4
    FROM_HANDLER = 8
    TRACED = 16


Body: TypeAlias = bytes | bytearray
"""The bytes behind a frame's header; a received large body is a bytearray."""

Frame: TypeAlias = tuple[int, int, int, int, int, Body]
"""type, flags, method, call_id, arg, body; a plain tuple, because it is the fastest to create."""


def pack_frame(
    type_: int, flags: int, method: int, call_id: int, arg: int, body: Body = b""
) -> bytes:
    """Return a frame as bytes."""
    return HEADER.pack(SIZE_OF_EMPTY + len(body), type_, flags, method, call_id, arg) + body


def pack_header(type_: int, flags: int, method: int, call_id: int, arg: int, size: int) -> bytes:
    """Return the header of a frame whose body of `size` bytes is written separately."""
    return HEADER.pack(SIZE_OF_EMPTY + size, type_, flags, method, call_id, arg)


class Splitter:
    """Cuts a byte stream into frames; the stream may arrive in any pieces.

    `limit` is the size of the largest accepted body. It is checked as soon as a header has arrived,
    and may be raised after the handshake. Memory grows only with the bytes that have arrived: it is
    at most `2 * GROWTH` times their size, or `2 * LARGE`.
    """

    __slots__ = ("behind", "error", "large", "limit", "most", "tail")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.error: ProtocolError | None = None
        """Set after an invalid length: no further frame can be read."""
        self.large: LargeBody | None = None
        """The large body that is arriving. Bytes may be written directly into its `room()`; then
        call `filled` instead of `feed`."""
        self.most = sys.maxsize
        """The largest number of frames that one `feed` returns."""
        self.behind = False
        """Whether `feed` stopped at this number; `feed(b"")` continues."""
        self.tail = b""
        """The beginning of a frame that has not arrived completely, or the frames that `feed` left
        because of `most`."""

    @property
    def mid_frame(self) -> bool:
        """Whether a frame has begun and not ended."""
        return bool(self.tail) or self.large is not None

    def take_tail(self) -> bytes:
        """Take back the bytes that `feed` kept; give them to the next `feed` before new ones."""
        tail, self.tail = self.tail, b""
        self.behind = False
        return tail

    def only(self, data: bytes) -> Frame | None:
        """Return the frame if `data` is exactly one frame; else None, and `feed` must be called.

        Most reads are exactly one frame; this is faster because it needs no lists.
        """
        size = len(data)
        if size < _HEADER_SIZE or self.tail or self.large is not None:
            return None
        length, type_, flags, method, call_id, arg = _unpack(data)
        if length + _LENGTH_SIZE != size or size > self.limit + _HEADER_SIZE:
            return None
        return type_, flags, method, call_id, arg, data[_HEADER_SIZE:]

    def filled(self, count: int) -> list[Frame]:
        """Count bytes that were written to `large`; return the frame once it is complete."""
        large = self.large
        assert large is not None, "filled() without a large body"
        if not large.filled(count):
            return []
        self.large = None
        return [(*large.header, large.body)]

    def feed(self, data: bytes, done: int = 0) -> list[Frame]:
        """Process the next bytes of the stream; return the frames that are complete now.

        `done` frames of the same read count against `most`. Check `error` afterwards. Frames before
        an invalid length are still returned, so that the result does not depend on how the stream
        is cut.
        """
        if self.large is not None:
            return self._feed_large(data)
        if self.tail:
            data = self.tail + data
            self.tail = b""
        self.error = None
        frames: list[Frame] = []
        self.behind = False
        start, size, longest, left = 0, len(data), self.limit, self.most - done
        while size - start >= _HEADER_SIZE:
            if not left:
                self.behind = True
                break
            left -= 1
            length, type_, flags, method, call_id, arg = _unpack(data, start)
            length -= SIZE_OF_EMPTY
            if not 0 <= length <= longest:
                self.error = self._bad_length(length)
                break
            body = start + _HEADER_SIZE
            end = body + length
            if end > size:
                if length < LARGE:
                    break
                self.large = LargeBody((type_, flags, method, call_id, arg), length, data[body:])
                return frames
            frames.append((type_, flags, method, call_id, arg, data[body:end]))
            start = end
        if start != size:
            self.tail = data[start:]
        return frames

    def _feed_large(self, data: bytes) -> list[Frame]:
        frames: list[Frame] = []
        offset = 0
        while self.large is not None and offset < len(data):
            room = self.large.room()
            count = min(len(room), len(data) - offset)
            room[:count] = data[offset : offset + count]
            offset += count
            frames = self.filled(count)
        return frames + self.feed(data[offset:]) if offset < len(data) else frames

    def _bad_length(self, length: int) -> ProtocolError:
        if length < 0:
            announced = length + SIZE_OF_EMPTY
            return ProtocolError(f"a frame's length is {announced}, shorter than its own header")
        return ProtocolError(f"a frame of {length} bytes; at most {self.limit} are accepted")


class LargeBody:
    """The buffer of a large body; it grows as the bytes arrive.

    A buffer of the announced size would be simpler. But then a peer could take megabytes with a
    header of sixteen bytes: Python writes zeros into every page of a new bytearray.
    """

    def __init__(self, header: tuple[int, int, int, int, int], size: int, start: bytes) -> None:
        self.header = header
        self.size = size
        """The size of the whole body in bytes; 0 if it is skipped."""
        self.is_announced = False
        """Whether the session has seen it; it reports a large request only once."""
        self._missing = size - len(start)
        self._received = len(start)
        self.body = bytearray(start)
        """The body once it is complete; before, the bytes so far and free space."""

    def room(self) -> memoryview:
        """Return the free part of the buffer, for the next bytes."""
        if not self.size:
            return memoryview(self.body)[: self._missing]
        if self._received == len(self.body):
            wanted = max(LARGE, GROWTH * self._received)
            # If the full size is at most twice the next step, take it at once: this saves a copy.
            grown = bytearray(self.size if self.size <= 2 * wanted else wanted)
            grown[: self._received] = self.body
            self.body = grown
        return memoryview(self.body)[self._received :]

    def filled(self, count: int) -> bool:
        """Count bytes that were written to `room()`; return whether the body is complete."""
        self._received += count
        self._missing -= count
        return not self._missing

    def skip(self) -> None:
        """Drop the body, and change its type so that the session skips the frame."""
        self.header = (SKIPPED, 0, 0, 0, 0)
        self.size = 0
        self.body = bytearray(LARGE)
