"""Converts messages to and from CDR, the encoding of ROS 2: XCDR1, little-endian.

After a header of four bytes (00 01 00 00) the fields follow in order. The position of a number
after the header is a multiple of its size; zero bytes fill the gaps. Nested messages have no header
of their own. A string is its length including a NUL, then UTF-8, then the NUL; a wstring is a count
of UTF-16 code units, then each unit in four bytes; a sequence is a count, then its elements; an
array of fixed length has no count. A nested message without fields is one byte.

The encoder and the decoder of a class are compiled at their first use (`plan`, `encode`,
`decode`), for loaded and for generated classes.

The decoder accepts more than the encoder writes: any last two bytes of the header, which other
vendors use for options; up to three bytes after the message, because DDS pads to a multiple of
four; a string of length 0 without the NUL. Every other encoding is refused: current robots do not
send big-endian data.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from .._runtime import Message, with_prefix
from ..convert import is_message_class, not_a_message, not_a_message_class
from .decode import decoder_of
from .encode import encoder_of
from .errors import CdrError
from .plan import KEPT_CLASSES

__all__ = ["CdrError", "from_cdr", "to_cdr"]

M = TypeVar("M", bound=Message)


class _Compiled(dict[Any, Callable[[Any], Any]]):
    """A function for each class, compiled at its first use."""

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

    The message is checked first, and its values are converted to their exact types.

    Raises:
        FieldError: a field has a value that its type does not allow.
        TypeError: the argument is not a message.
    """
    cls = type(message)
    if cls not in _encoders and not is_message_class(cls):
        raise not_a_message(message)
    try:
        message._check()
    except ValueError as error:  # a generated package has its own FieldError class
        raise with_prefix(error, "") from None
    data: bytes = _encoders[cls](message)
    return data


def from_cdr(cls: type[M], data: bytes | bytearray | memoryview) -> M:
    """Decode a message of this class; it needs no further check.

    The size of the data limits the memory, no matter which counts and lengths they announce.

    Args:
        cls: a message class, such as `AddTwoInts.Request`.
        data: a complete message with its header.

    Raises:
        CdrError: the data are not such a message; the error names the field.
        TypeError: `cls` is not a message class, or `data` are not bytes.
    """
    if type(data) is not bytes:
        data = bytes(memoryview(data))
    message: M = _decoders[cls](data)
    return message
