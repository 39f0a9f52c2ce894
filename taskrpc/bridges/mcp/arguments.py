"""Requests from the arguments of a tool call: exactly what the schema of the tool accepts. Pure.

rosbridge reads more than a schema says: digits as text, 1 as true, null as NaN. Here a value must
have the JSON type of its field. Then both convert it in the same way.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import msgspec

from srvgen import FieldError
from srvgen.convert import unknown_field
from taskrpc.bridges.rosbridge.values import from_json
from taskrpc.message_types import Msg

REQUEST_ID, DRY_RUN = "_request_id", "_dry_run"
"""Arguments of the tool itself: no field of ROS begins with an underscore."""
LONGEST_REQUEST_ID = 200
"""Characters."""

_LONGEST_SHOWN = 60
_BYTES = ("uint8[", "char[", "byte[")


class Arguments(msgspec.Struct, frozen=True):
    """The arguments of one call."""

    fields: Mapping[str, object]
    """The fields of the request or of the goal."""
    request_id: str = ""
    """The agent's own id for the request; "" for none."""
    is_dry_run: bool = False
    """Whether to say only what the call would do."""


def split(given: Mapping[str, object]) -> Arguments:
    """Return the arguments of the tool itself, and the fields. Raises FieldError."""
    fields = {name: value for name, value in given.items() if name not in (REQUEST_ID, DRY_RUN)}
    request_id, is_dry_run = given.get(REQUEST_ID, ""), given.get(DRY_RUN, False)
    if not isinstance(request_id, str) or (REQUEST_ID in given and not request_id):
        raise _wrong(REQUEST_ID, "a text that is not empty", request_id)
    if len(request_id) > LONGEST_REQUEST_ID:
        problem = f"expected at most {LONGEST_REQUEST_ID} characters, got {len(request_id)}"
        raise FieldError(REQUEST_ID, problem)
    if not isinstance(is_dry_run, bool):
        raise _wrong(DRY_RUN, "true or false", is_dry_run)
    return Arguments(fields, request_id, is_dry_run)


def message_of(cls: type[Msg], fields: Mapping[str, object]) -> Msg:
    """Return a checked message; missing fields have their defaults. Raises FieldError."""
    _check(cls, fields, "")
    message: Msg = from_json(cls, fields)
    return message


def _check(cls: Any, value: object, path: str) -> None:
    """Raise FieldError for a value whose JSON type is not that of its field."""
    if not isinstance(value, Mapping):
        names = ", ".join(name for name, _ in cls._FIELDS) or "no fields"
        raise _wrong(path, f"an object with the fields of {cls._TYPE} ({names})", value)
    types = dict(cls._FIELDS)
    for name, each in value.items():
        inner = f"{path}.{name}" if path else name
        if name not in types:
            raise FieldError(inner, unknown_field(cls, name))
        _check_field(types[name], cls._NESTED.get(name), each, inner)


def _check_field(type_: str, nested: Any, value: object, path: str) -> None:
    if "[" not in type_:
        _check_one(type_, nested, value, path)
        return
    if isinstance(value, str) and type_.startswith(_BYTES):
        return  # base64
    if not isinstance(value, list):
        raise _wrong(path, "a list", value)
    element = type_.partition("[")[0]
    for index, each in enumerate(value):
        _check_one(element, nested, each, f"{path}[{index}]")


def _check_one(type_: str, nested: Any, value: object, path: str) -> None:
    if nested is not None:
        _check(nested, value, path)
    elif type_ == "bool":
        _require(isinstance(value, bool), path, "true or false", value)
    elif type_.startswith(("string", "wstring")):
        _require(isinstance(value, str), path, "string", value)
    else:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        _require(is_number, path, type_, value)


def _require(fits: bool, path: str, expected: str, value: object) -> None:
    if not fits:
        raise _wrong(path, expected, value)


def _wrong(path: str, expected: str, value: object) -> FieldError:
    return FieldError(path, f"expected {expected}, got {_shown(value)}")


def _shown(value: object) -> str:
    try:
        text = json.dumps(value)
    except ValueError:  # Python refuses to print a very long integer
        return "a far larger number"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"
