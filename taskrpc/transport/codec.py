"""Message to msgpack and back: checked before sending, checked after receiving, never untyped."""

from __future__ import annotations

import re
from functools import cache
from typing import Any, Protocol, TypeVar

import msgspec

from taskrpc.errors import InvalidRequest


class MessageType(Protocol):
    """What srvgen's message classes (loaded or generated) have, as far as a transport needs it."""

    _TYPE: str
    _FIELDS: tuple[tuple[str, str], ...]
    _WIDTH: int

    def _check(self) -> None: ...


class ServiceType(Protocol):
    """What srvgen's service classes have, as far as a transport needs it."""

    Request: Any
    Response: Any
    _TYPE: str
    _HASH: str
    _DEFINITION: str


def _encode_array(value: Any) -> Any:
    """Numeric arrays know how they travel; nothing else that msgspec does not know may."""
    try:
        return value.little_endian()
    except AttributeError:
        raise InvalidRequest("", f"a {type(value).__name__} cannot be sent") from None


_encode = msgspec.msgpack.Encoder(enc_hook=_encode_array).encode
_AT_INDEX = re.compile(r"^(.*?)(?: - at `\$\[(\d+)\](.*)`)?$", re.DOTALL)

Message = TypeVar("Message")


class Codec:
    """Encodes and decodes one message class; make one for each class and keep it."""

    __slots__ = ("_cls", "_decode", "_header", "_long_header")

    def __init__(self, cls: type[MessageType]) -> None:
        self._cls = cls
        self._decode = msgspec.msgpack.Decoder(cls).decode
        width = cls._WIDTH
        # msgspec fills in what a short array leaves out; a body of the same definition has all.
        self._header = 0x90 | width if width < 16 else 0xDC
        self._long_header = b"" if width < 16 else bytes((0xDC, width >> 8, width & 0xFF))

    def encode(self, message: Any) -> bytes:
        """The message's body. Raises InvalidRequest for another type or a value out of place."""
        if message.__class__ is not self._cls:
            raise InvalidRequest("", f"expected a {self._cls._TYPE}, got {_type_of(message)}")
        try:
            message._check()
            return _encode(message)
        except ValueError as error:
            raise _invalid(error) from None

    def decode(self, body: bytes | bytearray) -> Any:
        """The message in a body. Raises InvalidRequest when it is not one of this class."""
        if not body or body[0] != self._header or not body.startswith(self._long_header):
            raise InvalidRequest(
                "", f"the body is not a {self._cls._TYPE} of {self._cls._WIDTH} fields"
            )
        try:
            message = self._decode(body)
            message._check()
        except msgspec.MsgspecError as error:
            raise self._not_decoded(error) from None
        except ValueError as error:
            raise _invalid(error) from None
        return message

    def _not_decoded(self, error: Exception) -> InvalidRequest:
        found = _AT_INDEX.match(str(error))
        if found is None or found[2] is None:
            return InvalidRequest("", str(error))
        name = self._cls._FIELDS[int(found[2])][0]
        return InvalidRequest(name + found[3], found[1])


@cache
def codec_of(cls: type[Any]) -> Codec:
    """The codec of a message class, made once."""
    return Codec(cls)


def _invalid(error: ValueError) -> InvalidRequest:
    return InvalidRequest(getattr(error, "path", ""), getattr(error, "problem", str(error)))


def _type_of(message: object) -> str:
    return str(getattr(type(message), "_TYPE", type(message).__name__))
