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
"""length of what follows this field, type, flags, method, call_id, arg."""

_LENGTH_SIZE = 4
SIZE_OF_EMPTY = HEADER.size - _LENGTH_SIZE
"""A header's length field, where no body follows."""
_HEADER_SIZE = HEADER.size
_unpack = HEADER.unpack_from
NO_DEADLINE = 0xFFFFFFFF
LARGE = 65_536
"""From this size on a body is collected in, and sent from, a buffer of its own."""
GROWTH = 4
"""How much larger a full buffer of a large body becomes: each time its bytes are copied once."""


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
    TRACED = 16


Body: TypeAlias = bytes | bytearray
"""What a frame carries behind its header; a large one that was received is a bytearray."""

Frame: TypeAlias = tuple[int, int, int, int, int, Body]
"""type, flags, method, call_id, arg, body: a plain tuple, since one is made for every frame."""


def pack_frame(
    type_: int, flags: int, method: int, call_id: int, arg: int, body: Body = b""
) -> bytes:
    """One frame as bytes."""
    return HEADER.pack(SIZE_OF_EMPTY + len(body), type_, flags, method, call_id, arg) + body


def pack_header(type_: int, flags: int, method: int, call_id: int, arg: int, size: int) -> bytes:
    """A frame's header alone, for a body of `size` bytes that is written separately."""
    return HEADER.pack(SIZE_OF_EMPTY + size, type_, flags, method, call_id, arg)


class Splitter:
    """Cuts a byte stream into frames, whatever the pieces in which it arrives.

    `limit` is the largest body that is accepted; it is checked against a frame's announced length
    before anything of the frame is kept. It may be raised after the handshake. Memory is taken as
    bytes arrive, never for an announcement: at most `2 * GROWTH` times what came,
    or two times `LARGE`.
    """

    __slots__ = ("_tail", "behind", "error", "large", "limit", "most")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.error: ProtocolError | None = None
        """Why no frame can follow those that were returned, once a length is not valid."""
        self.large: LargeBody | None = None
        """The large body that is arriving: its `room()` may be written to directly, then `filled`
        is called instead of `feed`."""
        self.most = sys.maxsize
        """The most frames that one `feed` returns."""
        self.behind = False
        """Whether it stopped there; `feed(b"")` goes on."""
        self._tail = b""

    @property
    def mid_frame(self) -> bool:
        """Whether a frame has begun and not ended."""
        return bool(self._tail) or self.large is not None

    def only(self, data: bytes) -> Frame | None:
        """The frame, where `data` is one and nothing else; None wherever `feed` must be asked.

        Most reads are of this kind, and this spares them the lists.
        """
        size = len(data)
        if size < _HEADER_SIZE or self._tail or self.large is not None:
            return None
        length, type_, flags, method, call_id, arg = _unpack(data)
        if length + _LENGTH_SIZE != size or size > self.limit + _HEADER_SIZE:
            return None
        return type_, flags, method, call_id, arg, data[_HEADER_SIZE:]

    def filled(self, count: int) -> list[Frame]:
        """Say that `count` bytes were written to `large`; returns the frame once it is whole."""
        large = self.large
        assert large is not None, "filled() without a large body"
        if not large.filled(count):
            return []
        self.large = None
        return [(*large.header, large.body)]

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes of the stream; returns the frames that they complete.

        Look at `error` afterwards: what came before a bad length is returned all the same, so that
        the cuts of the stream make no difference.
        """
        if self.large is not None:
            return self._feed_large(data)
        if self._tail:
            data = self._tail + data
            self._tail = b""
        self.error = None
        frames: list[Frame] = []
        self.behind = False
        start, size, longest, left = 0, len(data), self.limit, self.most
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
            self._tail = data[start:]
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
            told = length + SIZE_OF_EMPTY
            return ProtocolError(f"a frame's length is {told}, shorter than its own header")
        return ProtocolError(f"a frame of {length} bytes; at most {self.limit} are accepted")


class LargeBody:
    """A body that arrives in one buffer, which grows as the bytes come.

    A buffer of the announced size would be simpler, and would let sixteen bytes of a header take
    megabytes: Python writes zeros into every page of a new bytearray.
    """

    def __init__(self, header: tuple[int, int, int, int, int], size: int, start: bytes) -> None:
        self.header = header
        self.size = size
        """Bytes that are taken for it, and will be."""
        self.is_announced = False
        """Whether somebody was told of it."""
        self._missing = size - len(start)
        self._received = len(start)
        self.body = bytearray(start)
        """Once it is whole; then only its receiver has it."""

    def room(self) -> memoryview:
        """Where the next bytes belong."""
        if not self.size:
            return memoryview(self.body)[: self._missing]
        if self._received == len(self.body):
            wanted = max(LARGE, GROWTH * self._received)
            # Not twice for the sake of a few last bytes: that would copy all of it once more.
            grown = bytearray(self.size if self.size <= 2 * wanted else wanted)
            grown[: self._received] = self.body
            self.body = grown
        return memoryview(self.body)[self._received :]

    def filled(self, count: int) -> bool:
        """Count bytes that were written to `room()`; returns whether the body is whole."""
        self._received += count
        self._missing -= count
        return not self._missing

    def skip(self) -> None:
        """Keep nothing of it, and have it skipped by whoever gets it as a frame."""
        self.header = (FIRST_OPTIONAL_TYPE, 0, 0, 0, 0)
        self.size = 0
        self.body = bytearray(LARGE)
