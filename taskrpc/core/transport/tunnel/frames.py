"""The datagrams of a tunnel: a header of fixed size, and bytes of a connection behind it.

Each end of a connection chooses a random id. A datagram carries the id that its receiver has
chosen, so a program finds the connection without knowing the sender.

| kind   | receiver's id | number   | limit | behind the header                      |
|--------|---------------|----------|-------|----------------------------------------|
| SYN    | 0             | 0        | yes   | the caller's id, and the caller's address |
| ACK    | yes           | 0        | yes   | the server's id                        |
| DATA   | yes           | counts   | yes   | bytes of the connection                |
| CREDIT | yes           | 0        | yes   |                                        |
| FIN    | yes           | counts   | yes   |                                        |
| RST    | yes           | 0        | 0     | the reason                             |

`number` counts DATA and FIN of one direction, so that a missing datagram is noticed. `limit` is the
number of bytes, counted from the start of the connection, that the sender is ready to receive.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import TypeAlias

VERSION = 1
"""The version of this format, in the upper half of the first byte."""
_HEADER = struct.Struct("<BQIQ")
HEADER_SIZE = _HEADER.size
_ID = struct.Struct("<Q")
MAX_DATA = 65_536
"""Bytes of a connection in one datagram."""
MAX_ADDRESS = 512
"""Bytes of an address."""
MAX_REASON = 200
"""Characters of a reason."""


class Kind(IntEnum):
    """What a datagram does."""

    SYN = 1
    """Asks for a connection."""
    ACK = 2
    """Accepts it."""
    DATA = 3
    CREDIT = 4
    """Only raises the limit."""
    FIN = 5
    """The sender has written everything."""
    RST = 6
    """The connection has ended at once."""


Datagram: TypeAlias = tuple[int, int, int, int, memoryview]
"""A datagram that was received: kind, id of the connection at its receiver, number, limit, and what
follows the header. A plain tuple, because each call needs two of them."""

_SYN, _RST, _VERSION_BITS = int(Kind.SYN), int(Kind.RST), VERSION << 4


def parse(data: bytes) -> Datagram | None:
    """Return the parts of a datagram; None for garbage and for other versions."""
    if len(data) < HEADER_SIZE:
        return None
    first, to, number, limit = _HEADER.unpack_from(data)
    kind = first ^ _VERSION_BITS
    if not _SYN <= kind <= _RST:
        return None
    return kind, to, number, limit, memoryview(data)[HEADER_SIZE:]


def pack(kind: Kind, to: int, number: int = 0, limit: int = 0) -> bytes:
    """Return the header of a datagram."""
    return _HEADER.pack(_VERSION_BITS | kind, to, number, limit)


def pack_syn(own_id: int, address: str, limit: int) -> bytes:
    """Return the datagram with which the program at `address` asks for a connection."""
    return pack(Kind.SYN, 0, 0, limit) + _ID.pack(own_id) + address.encode()


def parse_syn(data: memoryview) -> tuple[int, str] | None:
    """Return the caller's id and address from a SYN; None if they are not valid."""
    if not _ID.size < len(data) <= _ID.size + MAX_ADDRESS:
        return None
    try:
        return _ID.unpack_from(data)[0], str(data[_ID.size :], "utf-8")
    except UnicodeDecodeError:
        return None


def pack_ack(to: int, own_id: int, limit: int) -> bytes:
    """Return the datagram that accepts the connection which the caller calls `to`."""
    return pack(Kind.ACK, to, 0, limit) + _ID.pack(own_id)


def parse_ack(data: memoryview) -> int | None:
    """Return the server's id from an ACK; None if it is not valid."""
    found: int | None = _ID.unpack(data)[0] if len(data) == _ID.size else None
    return found


def pack_reset(to: int, reason: str) -> bytes:
    """Return the datagram that ends a connection at once."""
    return pack(Kind.RST, to) + reason[:MAX_REASON].encode()


def parse_reset(data: memoryview) -> str:
    """Return the reason from an RST."""
    return str(data[: 4 * MAX_REASON], "utf-8", "replace")
