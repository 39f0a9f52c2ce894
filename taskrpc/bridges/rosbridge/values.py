"""Messages as JSON values of rosbridge, and back.

Three things differ from plain JSON: arrays of uint8 and char are base64 text, numbers that JSON
does not have (NaN, infinities) are null, and a time has two spellings.
"""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

from srvgen import FieldError, from_builtins

Stamp: TypeAlias = tuple[int, int]
"""Seconds and nanoseconds since 1970."""

_TIME = "builtin_interfaces/msg/Time"
_TIMES = (_TIME, "builtin_interfaces/msg/Duration")
_HEADER = "std_msgs/msg/Header"
_OLD_TIME_FIELDS = {"secs": "sec", "nsecs": "nanosec"}
"""The names that ROS 1 had for the fields of a time, and that some clients still send."""
_INTEGERS = ("int", "uint", "char", "byte")
_KEPT_CLASSES = 1024
"""Message classes whose conversions are cached."""


class _Outgoing(NamedTuple):
    """How one field becomes JSON."""

    name: str
    attribute: str
    convert: Callable[[Any], Any] | None
    """None for values that JSON has itself; the JSON encoder writes NaN as null."""


def to_json(message: Any) -> dict[str, Any]:
    """Return a message as a value for `msgspec.json.encode`, which writes NaN as null."""
    return {
        name: getattr(message, attribute)
        if convert is None
        else convert(getattr(message, attribute))
        for name, attribute, convert in _outgoing(message.__class__)
    }


def from_json(cls: Any, value: object, now: Stamp | None = None) -> Any:
    """Return a checked message from a JSON value; missing fields have their defaults.

    With `now`, headers without a stamp get this time, as rosbridge promises for topics.

    Raises FieldError.
    """
    return from_builtins(cls, _prepared(cls, value, now, ""))


def request_from_json(cls: Any, args: object) -> Any:
    """Return a request from the `args` of a call: an object, a list in field order, or null.

    Raises FieldError.
    """
    return from_json(cls, _named(cls, args))


def _named(cls: Any, args: object) -> object:
    if args is None:
        return {}
    if not isinstance(args, list):
        return args
    names = [name for name, _ in cls._FIELDS]
    # Some clients put the object with all arguments into a list.
    if len(args) == 1 and isinstance(args[0], dict) and (not names or args[0].keys() <= {*names}):
        first = cls._NESTED.get(names[0]) if names else None
        if first is None:
            return args[0]
    if len(args) > len(names):
        problem = f"expected at most {len(names)} arguments ({', '.join(names)}), got {len(args)}"
        raise FieldError("", problem)
    return dict(zip(names, args, strict=False))


# From messages to JSON


@lru_cache(_KEPT_CLASSES)
def _outgoing(cls: Any) -> tuple[_Outgoing, ...]:
    attributes = cls.__struct_fields__  # a keyword has an underscore at its end
    return tuple(
        _Outgoing(name, attribute, _converter(type_, name in cls._NESTED))
        for (name, type_), attribute in zip(cls._FIELDS, attributes, strict=True)
    )


def _converter(type_: str, nested: bool) -> Callable[[Any], Any] | None:
    if nested:
        return _messages if "[" in type_ else to_json
    if _is_binary(type_):
        return _base64
    if type_.startswith("byte"):
        return _numbers_of_bytes if "[" in type_ else ord
    return _list if "[" in type_ else None


def _is_binary(type_: str) -> bool:
    return type_.startswith(("uint8[", "char["))


def _base64(values: Any) -> str:
    return base64.b64encode(values).decode("ascii")


def _messages(values: list[Any]) -> list[dict[str, Any]]:
    return [to_json(each) for each in values]


def _numbers_of_bytes(values: list[bytes]) -> list[int]:
    return [ord(each) for each in values]


def _list(values: Any) -> list[Any]:
    listed: list[Any] = values if isinstance(values, list) else values.tolist()
    return listed


# From JSON to messages


def _prepared(cls: Any, value: object, now: Stamp | None, path: str) -> object:
    """Replace the spellings of rosbridge in a value by those of `from_builtins`."""
    if not isinstance(value, Mapping):
        if cls._TYPE == _TIME and value == "now" and now is not None:
            return _time(now)
        return value
    if cls._TYPE in _TIMES:
        value = _with_new_names(value)
    elif cls._TYPE == _HEADER:
        value = _complete_header(value, now)
    types = _types(cls)
    fields = {}
    for name, each in value.items():
        if name in types:
            convert = types[name]
            fields[name] = each if convert is None else convert(each, now, _inside(path, name))
        else:
            fields[name] = each  # `from_builtins` names the unknown field
    if now is not None and "header" not in fields and _has_header(cls):
        fields["header"] = {"stamp": _time(now)}
    return fields


_Incoming: TypeAlias = Callable[[Any, "Stamp | None", str], Any]


@lru_cache(_KEPT_CLASSES)
def _types(cls: Any) -> dict[str, _Incoming | None]:
    return {name: _reader(type_, cls._NESTED.get(name)) for name, type_ in cls._FIELDS}


def _reader(type_: str, nested: Any) -> _Incoming | None:
    if nested is not None:
        if "[" not in type_:
            return lambda value, now, path: _prepared(nested, value, now, path)
        return lambda values, now, path: (
            [_prepared(nested, each, now, f"{path}[{i}]") for i, each in enumerate(values)]
            if isinstance(values, list)
            else values
        )
    if "[" not in type_:
        one = _reader_of_one(type_)
        return None if one is None else lambda value, now, path: one(value)
    if _is_binary(type_) or type_.startswith("byte"):
        return _bytes
    element = _reader_of_one(type_)
    if element is None:
        return None
    return lambda values, now, path: (
        [element(each) for each in values] if isinstance(values, list) else values
    )


def _reader_of_one(type_: str) -> Callable[[Any], Any] | None:
    if type_.startswith("float"):
        return _float
    return _integer if type_.startswith(_INTEGERS) else None


def _float(value: Any) -> Any:
    return math.nan if value is None else value


def _integer(value: Any) -> Any:
    """Return the integer that a client meant.

    Some languages have only one kind of number (2.0), and send integers above 2**53 as text.
    """
    if isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, str) and len(value) <= 20 and value.removeprefix("-").isdecimal():
        return int(value)
    return value


def _bytes(value: Any, _: Stamp | None, path: str) -> Any:
    if isinstance(value, list):
        return [_integer(each) for each in value]
    if not isinstance(value, str):
        return value
    try:
        return list(base64.b64decode(value, validate=True))
    except (binascii.Error, ValueError):
        raise FieldError(path, "expected base64 text or a list of numbers") from None


def _with_new_names(value: Mapping[str, Any]) -> dict[str, Any]:
    fields = dict(value)
    for old, new in _OLD_TIME_FIELDS.items():
        if old in fields:
            fields.setdefault(new, fields.pop(old))
            fields.pop(old, None)
    return fields


def _complete_header(value: Mapping[str, Any], now: Stamp | None) -> dict[str, Any]:
    # Clients for ROS 1 send its counter, which ROS 2 does not have.
    fields = {name: each for name, each in value.items() if name != "seq"}
    if now is not None and fields.get("stamp") is None:
        fields["stamp"] = _time(now)
    return fields


def _has_header(cls: Any) -> bool:
    return bool(getattr(cls._NESTED.get("header"), "_TYPE", "") == _HEADER)


def _time(now: Stamp) -> dict[str, int]:
    seconds, nanoseconds = now
    return {"sec": seconds, "nanosec": nanoseconds}


def _inside(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name
