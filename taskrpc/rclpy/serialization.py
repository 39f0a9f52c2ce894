"""Messages from and to CDR bytes, the encoding of ROS 2."""

from __future__ import annotations

from typing import Any, TypeVar

from srvgen import from_cdr, to_cdr

from ._impl.bridge import detached
from .type_support import check_for_type_support

T = TypeVar("T")


def serialize_message(message: Any) -> bytes:
    """Encode a message as CDR with its 4-byte header; AttributeError for another object."""
    check_for_type_support(type(message))
    return to_cdr(detached(message))


def deserialize_message(serialized_message: bytes, message_type: type[T]) -> T:
    """Decode CDR bytes to a message of this type."""
    read: Any = from_cdr
    message: T = read(message_type, serialized_message)
    return message
