"""Messages from and to CDR bytes, the encoding of ROS 2."""

from __future__ import annotations

from typing import Any, TypeVar

from srvgen import CdrError, from_cdr, to_cdr

from ._impl.bridge import detached
from .exceptions import RMWError
from .type_support import check_for_type_support

T = TypeVar("T")


def serialize_message(message: Any) -> bytes:
    """Encode a message as CDR with its 4-byte header; AttributeError for another object."""
    check_for_type_support(type(message))
    return to_cdr(detached(message))


def deserialize_message(serialized_message: bytes, message_type: type[T]) -> T:
    """Decode CDR bytes to a message of this type.

    Raises RMWError for bytes that are not such a message, AttributeError for another type.
    """
    check_for_type_support(message_type)
    read: Any = from_cdr
    try:
        message: T = read(message_type, serialized_message)
    except CdrError as error:
        raise RMWError(f"failed to deserialize ROS message: {error}") from None
    return message
