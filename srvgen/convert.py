"""Converts messages to and from plain dicts, lists and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from ._runtime import FieldError, Message, short_repr, to_list, with_prefix
from .definitions.names import similar_names

M = TypeVar("M", bound=Message)


def to_builtins(message: Message) -> dict[str, Any]:
    """A message as dict, list, int, float, str and bool, with the names of ROS; a byte is an int.

    The message is checked first, and its values are converted to their exact types.

    Raises:
        FieldError: a field has a value that its type does not allow.
        TypeError: the argument is not a message.
    """
    _check(message)
    return _plain_message(message)


def from_builtins(cls: type[M], obj: Any) -> M:
    """A checked message from a dict; fields that are missing in it keep their defaults.

    Raises:
        FieldError: an unknown field, or a value that the field's type does not allow.
        TypeError: `cls` is not a message class.
    """
    if not is_message_class(cls):
        raise not_a_message_class(cls)
    message = _build(cls, obj, "")
    _check(message)
    return message


def is_message_class(cls: object) -> bool:
    """Whether it is a message class, loaded or generated."""
    return isinstance(cls, type) and hasattr(cls, "_FIELDS")


def not_a_message(value: object) -> TypeError:
    """The error for a value that is not a message."""
    example = "such as AddTwoInts.Request()"
    return TypeError(f"expected a message, {example}, got {short_repr(value)}")


def not_a_message_class(value: object) -> TypeError:
    """The error for a value that is not a message class."""
    example = "such as AddTwoInts.Request"
    return TypeError(f"expected a message class, {example}, got {short_repr(value)}")


def _check(message: Message) -> None:
    if not is_message_class(type(message)):
        raise not_a_message(message)
    try:
        message._check()
    except ValueError as error:  # a generated package has its own FieldError class
        raise with_prefix(error, "") from None


def _plain_message(message: Message) -> dict[str, Any]:
    pairs = zip(message._FIELDS, message.__struct_fields__, strict=True)
    return {name: _plain(getattr(message, attribute)) for (name, _), attribute in pairs}


def _plain(value: Any) -> Any:
    if hasattr(value, "_FIELDS"):  # messages of a generated package have their own base class
        return _plain_message(value)
    if isinstance(value, bytes):
        return value[0]
    if isinstance(value, list):
        return _plain_list(value)
    return value.tolist() if hasattr(value, "tolist") else value


def _plain_list(values: list[Any]) -> list[Any]:
    """The elements of a checked list, which are all of one type."""
    if values and hasattr(values[0], "_FIELDS"):
        return [_plain_message(each) for each in values]
    return list(b"".join(values)) if values and isinstance(values[0], bytes) else list(values)


def _build(cls: type[M], obj: Any, path: str) -> M:
    if type(obj) is cls:
        return obj
    if not isinstance(obj, Mapping):
        names = ", ".join(name for name, _ in cls._FIELDS) or "no fields"
        raise FieldError(
            path, f"expected the fields of {cls._TYPE} ({names}), got {short_repr(obj)}"
        )
    attributes = {
        name: attribute
        for (name, _), attribute in zip(cls._FIELDS, cls.__struct_fields__, strict=True)
    }
    values = {}
    for name, value in obj.items():
        if name not in attributes:
            raise with_prefix(FieldError(str(name), unknown_field(cls, name)), path)
        values[attributes[name]] = _field(cls, name, value, path)
    return cls(**values)


def _field(cls: type[Message], name: str, value: Any, path: str) -> Any:
    nested = cls._NESTED.get(name)
    if nested is None:
        return value
    inner = f"{path}.{name}" if path else name
    if "[" not in dict(cls._FIELDS)[name]:
        return _build(nested, value, inner)
    items = to_list(value, inner)
    return [_build(nested, item, f"{inner}[{i}]") for i, item in enumerate(items)]


def unknown_field(cls: type[Message], name: object) -> str:
    """Say that a message class has no such field, and which fields it has."""
    known = [one for one, _ in cls._FIELDS]
    similar = similar_names(name, known) if isinstance(name, str) else []
    hint = f"; did you mean {similar[0]!r}?" if similar else ""
    has = ", ".join(known) if known else "no fields"
    return f"unknown field {name!r}; {cls.__name__} has {has}{hint}"
