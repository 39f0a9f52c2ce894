"""Messages as the bytes that robots exchange."""

from __future__ import annotations

from typing import Any, TypeVar

from srvgen import from_cdr, to_cdr

from ._impl.bridge import detached
from .type_support import check_for_type_support

T = TypeVar("T")


def serialize_message(message: Any) -> bytes:
    """A message as CDR, with its header of four bytes; AttributeError for what is no message."""
    check_for_type_support(type(message))
    return to_cdr(detached(message))


def deserialize_message(serialized_message: bytes, message_type: type[T]) -> T:
    """The message of this type that the bytes are."""
    read: Any = from_cdr
    message: T = read(message_type, serialized_message)
    return message
