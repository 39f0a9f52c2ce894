"""Messages as CDR, the encoding of ROS 2 robots: XCDR1, little-endian.

Behind a header of four bytes (00 01 00 00) the fields follow in order. Numbers stand at multiples
of their size, counted from behind the header, with zero bytes in the gaps; nested messages add
nothing of their own. A string is its length with a NUL, then UTF-8, then the NUL; a wstring is a
count of UTF-16 code units, then each in four bytes; a sequence is a count, then its elements; an
array of fixed length has no count. A message without fields is one byte where it is nested.

For each class an encoder and a decoder are compiled when they are first asked for (`cdr_plan`,
`cdr_encode`, `cdr_decode`), for loaded and for generated classes alike.

What is read more generously than it is written: the last two bytes of the header, which other
vendors use for options; up to three bytes behind the message, with which DDS fills up to a
multiple of four; a string of length 0, which lacks the NUL, as the empty one. Every other encoding
is refused: no robot of today sends big-endian.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from .._runtime import Message, under
from ..convert import is_message_class, not_a_message, not_a_message_class
from .decode import decoder_of
from .encode import encoder_of
from .errors import CdrError
from .plan import KEPT_CLASSES

__all__ = ["CdrError", "from_cdr", "to_cdr"]

M = TypeVar("M", bound=Message)


class _Compiled(dict[Any, Callable[[Any], Any]]):
    """A function for each class, made when it is first asked for."""

    def __init__(self, make: Callable[[Any], Callable[[Any], Any]]) -> None:
        super().__init__()
        self._make = make

    def __missing__(self, cls: Any) -> Callable[[Any], Any]:
        if not is_message_class(cls):
            raise not_a_message_class(cls)
        if len(self) >= KEPT_CLASSES:
            self.pop(next(iter(self)), None)
        made = self[cls] = self._make(cls)
        return made


_encoders = _Compiled(encoder_of)
_decoders = _Compiled(decoder_of)


def to_cdr(message: Message) -> bytes:
    """A message as CDR, with its header.

    The message is checked first, and brought to its exact types, as when it is sent.

    Raises:
        FieldError: a field holds what its type does not allow.
        TypeError: it is no message.
    """
    cls = type(message)
    if cls not in _encoders and not is_message_class(cls):
        raise not_a_message(message)
    try:
        message._check()
    except ValueError as error:  # a generated package has a FieldError of its own
        raise under(error, "") from None
    data: bytes = _encoders[cls](message)
    return data


def from_cdr(cls: type[M], data: bytes | bytearray | memoryview) -> M:
    """The message of this class that the bytes are; it needs no further check.

    Memory is bounded by the size of the data, whatever counts and lengths they announce.

    Args:
        cls: a message class, such as `AddTwoInts.Request`.
        data: a whole message with its header.

    Raises:
        CdrError: the data are not such a message; says which field is wrong.
        TypeError: `cls` is no message class, or `data` are no bytes.
    """
    if type(data) is not bytes:
        data = bytes(memoryview(data))
    message: M = _decoders[cls](data)
    return message
