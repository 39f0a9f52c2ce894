"""Bytes in a `std_msgs/msg/UInt8MultiArray`, encoded as CDR without any Python object. Pure.

Every ROS has this type. Its encoding: 4 bytes header, the number of dimensions (0), the offset of
the data (0), the number of bytes, the bytes.
"""

from __future__ import annotations

import struct

TYPE = "std_msgs/msg/UInt8MultiArray"
_START = b"\x00\x01\x00\x00" + bytes(8)
_LENGTH = struct.Struct("<I")
_SIZE = len(_START) + _LENGTH.size


def pack(data: bytes) -> bytes:
    """Return the encoded message."""
    return _START + _LENGTH.pack(len(data)) + data


def unpack(body: bytes) -> bytes | None:
    """Return the bytes; None if it is not such a message."""
    if len(body) < _SIZE or body[:2] != _START[:2] or body[4 : len(_START)] != _START[4:]:
        return None
    (length,) = _LENGTH.unpack_from(body, len(_START))
    # Some middlewares fill up the message to a multiple of four.
    return body[_SIZE : _SIZE + length] if len(body) - _SIZE >= length else None
