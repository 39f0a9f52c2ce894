"""Copies of what a program sends: a check before sending must not change the program's own."""

from __future__ import annotations

from functools import cache
from typing import Any


def detached(message: Any) -> Any:
    """A copy of a message, with copies of the messages in it; values are the same objects."""
    made = message.__copy__()
    cls: Any = type(message)
    for attribute in _nested(cls):
        setattr(made, attribute, _copied(getattr(made, attribute)))
    return made


def _copied(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_copied(one) for one in value]
    return detached(value) if hasattr(type(value), "_NESTED") else value


@cache
def _nested(cls: type[Any]) -> list[str]:
    """The attributes of a class that hold messages."""
    fields = zip(cls.__struct_fields__, cls._FIELDS, strict=True)
    return [attribute for attribute, (name, _) in fields if name in cls._NESTED]
