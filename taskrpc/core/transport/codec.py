"""Encodes messages as msgpack and decodes them; checks them before sending and after receiving."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Protocol, cast, get_type_hints

import msgspec

from taskrpc.core.wire.frames import Body
from taskrpc.errors import InvalidRequest


class MessageType(Protocol):
    """The attributes of srvgen's message classes that a transport needs; see `srvgen._runtime`."""

    _TYPE: str
    _FIELDS: tuple[tuple[str, str], ...]
    _NESTED: Mapping[str, type[Any]]
    _WIDTH: int

    def _check(self) -> None: ...


class ServiceType(Protocol):
    """The attributes of srvgen's service classes that a transport needs."""

    Request: Any
    Response: Any
    _TYPE: str
    _HASH: str
    _DEFINITION: str


def _encode_array(value: Any) -> Any:
    """Encode a numeric array, the only value in messages that msgspec does not know."""
    try:
        return value.little_endian()
    except AttributeError:
        raise InvalidRequest("", f"a {type(value).__name__} cannot be sent") from None


pack = msgspec.msgpack.Encoder(enc_hook=_encode_array).encode
"""Encodes a message that was checked."""

_PROBLEM = r"(?s)^(.*?)(?: - at `\$(.*)`)?$"
"""A text of msgspec: the problem, and the field. Python compiles the pattern at the first one."""

KEPT_CLASSES = 1024
"""Message classes whose codecs are cached; a program can create any number of classes."""

_HARMLESS = 2**24
"""Bytes of memory that msgspec may fill with default values for one body."""


class Codec:
    """Encodes and decodes one message class; `codec_of` caches them.

    `encode(message)` returns the body. It raises InvalidRequest for another type, or if a value
    does not fit its field. `decode(body)` returns the message. It raises InvalidRequest for a body
    of another class.
    """

    __slots__ = ("_cls", "_shape", "decode", "encode")

    def __init__(self, cls: type[MessageType]) -> None:
        self._cls = cls
        self._shape: Callable[[Body], Any] | None = None
        """Checks that a body has every field; created for the first long body."""
        # Closures instead of methods: every call uses them, and closure variables are fastest.
        self.encode: Callable[[Any], bytes] = self._encoder(cls)
        self.decode: Callable[[Body], Any] = self._decoder(cls)

    def _encoder(self, cls: type[MessageType]) -> Callable[[Any], bytes]:
        def encode(message: Any) -> bytes:
            # A message with checked fields has a class of its own, made from the original.
            if message.__class__ is not cls and getattr(message, "_ORIGINAL", None) is not cls:
                raise wrong_class(cls, message)
            try:
                message._check()
                return pack(message)
            except ValueError as error:
                raise invalid_value(error) from None

        return encode

    def _decoder(self, cls: type[MessageType]) -> Callable[[Body], Any]:
        decode_any = msgspec.msgpack.Decoder(cls).decode
        # msgspec would fill in missing fields, but a body of the same definition has all fields.
        header = _array_header(cls._WIDTH)
        # For each empty array in a sequence of messages, msgspec creates a whole message. So a long
        # body of empty arrays could take far more memory than its size: its shape is checked.
        largest = _largest_element(cls)
        harmless = _HARMLESS // largest if largest else None
        start = len(header)
        # A package that an earlier srvgen has generated does not have the attribute.
        needs_check = not getattr(cls, "_DECODES_EXACTLY", False)

        def decode(body: Body) -> Any:
            if body[:start] != header:
                problem = f"the body is not a {cls._TYPE} of {cls._WIDTH} fields"
                raise InvalidRequest("", problem)
            try:
                if harmless is not None and len(body) > harmless:
                    self._check_shape(body)
                message = decode_any(body)
                if needs_check:
                    message._check()
            except (msgspec.MsgspecError, RecursionError) as error:
                raise self._not_decoded(error) from None
            except ValueError as error:
                raise invalid_value(error) from None
            return message

        return decode

    def _check_shape(self, body: Body) -> None:
        if self._shape is None:
            self._shape = msgspec.msgpack.Decoder(_shape_of(self._cls)).decode
        self._shape(body)

    def _not_decoded(self, error: Exception) -> InvalidRequest:
        found = re.match(_PROBLEM, str(error))
        if found is None or not found[2]:
            return InvalidRequest("", str(error))
        return InvalidRequest(_field_path(self._cls, re.findall(r"\[(.*?)\]", found[2])), found[1])


def _array_header(width: int) -> bytes:
    return bytes((0x90 | width,)) if width < 16 else bytes((0xDC, width >> 8, width & 0xFF))


def _field_path(cls: type[MessageType] | None, steps: list[str]) -> str:
    """Return the path of a field: `poses[3].header.frame_id` for msgspec's indexes 1, 3, 0, 1."""
    path = ""
    rest = iter(steps)
    for step in rest:
        if cls is None:
            return f"{path}[{step}]"
        name, type_ = cls._FIELDS[int(step)]
        path += f".{name}" if path else name
        cls = cls._NESTED.get(name)
        if "[" in type_ and (index := next(rest, None)) is not None:
            path += f"[{index}]"
    return path


@lru_cache(KEPT_CLASSES)
def _largest_element(cls: type[MessageType]) -> int:
    """Return the bytes of the largest default message that can be an element in this class."""
    sizes = [0]
    for name, type_ in cls._FIELDS:
        nested: Any = cls._NESTED.get(name)
        if nested is not None:
            sizes += [_largest_element(nested), _memory(nested()) if "[" in type_ else 0]
    return max(sizes)


def _memory(value: Any) -> int:
    """Estimate the bytes of a default message, or of one of its values."""
    size = sys.getsizeof(value)
    if hasattr(value, "_FIELDS"):
        return size + sum(_memory(getattr(value, name)) for name in value.__struct_fields__)
    is_list = isinstance(value, list) and len(value) > 0
    return size + len(value) * _memory(value[0]) if is_list else size


@lru_cache(KEPT_CLASSES)
def _shape_of(cls: type[MessageType]) -> type[msgspec.Struct]:
    """Create a class with the same fields, all required, so that msgspec adds no defaults."""
    fields: list[tuple[str, Any]] = []
    hints = get_type_hints(cls)
    attributes = cast("Any", cls).__struct_fields__  # a keyword has an underscore at its end
    for index, ((name, type_), attribute) in enumerate(zip(cls._FIELDS, attributes, strict=True)):
        nested: Any = cls._NESTED.get(name)
        inner: Any = hints[attribute] if nested is None else _shape_of(nested)
        is_list = nested is not None and "[" in type_
        fields.append((f"field_{index}", list[inner] if is_list else inner))
    return msgspec.defstruct(
        cls.__name__, fields, array_like=True, forbid_unknown_fields=True, gc=False
    )


@lru_cache(KEPT_CLASSES)
def codec_of(cls: type[Any]) -> Codec:
    """Return the codec of a message class from the cache."""
    return Codec(cls)


def invalid_value(error: ValueError) -> InvalidRequest:
    """Return the error for a message that did not pass its check."""
    return InvalidRequest(getattr(error, "path", ""), getattr(error, "problem", str(error)))


def wrong_class(cls: type[MessageType], message: object) -> InvalidRequest:
    """Return the error for a message of another class than the expected one."""
    return InvalidRequest("", f"expected a {cls._TYPE}, got {described(message)}")


def described(message: object) -> str:
    """Return what a value is, for an error: its type, or that it is a class."""
    if isinstance(message, type):
        return f"the class {message.__name__} itself; write {message.__name__}()"
    return str(getattr(type(message), "_TYPE", type(message).__name__))
