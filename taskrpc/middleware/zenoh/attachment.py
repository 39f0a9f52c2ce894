"""The attachment of each request, response and message: sequence number, time and sender. Pure."""

from __future__ import annotations

import struct
from typing import NamedTuple

GID_SIZE = 16
_FORMAT = struct.Struct(f"<qqB{GID_SIZE}s")


class Attachment(NamedTuple):
    """The fields of an attachment."""

    sequence: int
    """Counts the messages of one sender, from 1. A response repeats that of its request."""
    stamp: int
    """When it was sent: nanoseconds since the epoch."""
    gid: bytes
    """The id of the sender: 16 bytes. A response repeats that of its request."""


def pack(sequence: int, stamp: int, gid: bytes) -> bytes:
    """Return the 33 bytes of an attachment."""
    return _FORMAT.pack(sequence, stamp, GID_SIZE, gid)


def parse(data: bytes) -> Attachment | None:
    """Return the fields of an attachment; None for garbage. Bytes after the 33rd are ignored."""
    if len(data) < _FORMAT.size:
        return None
    sequence, stamp, size, gid = _FORMAT.unpack_from(data)
    return Attachment(sequence, stamp, gid) if size == GID_SIZE else None
