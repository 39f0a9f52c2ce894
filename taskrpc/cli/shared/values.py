"""Reads the request of a call from YAML or FIELD=VALUE, using the types of its fields.

Because the types are known, a string field takes the text unchanged: `target=3,4`, `{mode: on}`
and `{id: 007}` need no quotes. A number that an integer field cannot hold is refused.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from copy import deepcopy
from typing import Any

from srvgen import FieldError, from_builtins
from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import hinted
from taskrpc.cli.shared.quoting import not_populated
from taskrpc.errors import InvalidRequest

_TYPE = re.compile(r"[A-Za-z]\w*/(?:\w+/)?\w+")
_ASSIGNMENT = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)=(.*)", re.DOTALL)
_SIMPLE = re.compile(
    r"(?P<number>-?(?:0|[1-9]\d{0,14})(\.\d{1,15})?)|[A-Za-z0-9][\w./-]*", re.ASCII
)


def split_type(arguments: Sequence[str]) -> tuple[str, list[str]]:
    """Return the type that a command line names ("" if none), and the request after it."""
    if arguments and _TYPE.fullmatch(arguments[0]):
        return arguments[0], list(arguments[1:])
    return "", list(arguments)


def build_request(cls: Any, values: Sequence[str]) -> Any:
    """Make a request of this class from one YAML text or from any number of FIELD=VALUE.

    Raises InvalidRequest.
    """
    return from_fields(cls, read_fields(cls, values))


def as_typed(message: Any) -> Any:
    """Return a copy whose float32 numbers have few digits: 0.2 instead of 0.20000000298023224.

    `ros2` prints the numbers of a command line before it rounds them to float32.
    """
    copy = deepcopy(message)
    _shorten(copy)
    return copy


def _shorten(message: Any) -> None:
    for name, kind in type(message).get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind == "float":
            setattr(message, name, _shortest(value))
        elif hasattr(value, "get_fields_and_field_types"):
            _shorten(value)
        elif isinstance(value, list) and hasattr(next(iter(value), None), "_FIELDS"):
            for each in value:
                _shorten(each)


def _shortest(value: float) -> float:
    """Return the number of fewest digits that is the same as a float32."""
    if not math.isfinite(value):
        return value
    packed = struct.pack("<f", value)
    texts = (float(f"{value:.{digits}g}") for digits in range(1, 9))
    return next((each for each in texts if _packs_to(each, packed)), value)


def _packs_to(value: float, packed: bytes) -> bool:
    try:
        return struct.pack("<f", value) == packed
    except OverflowError:  # rounded up above the largest float32
        return False


def from_fields(cls: Any, fields: dict[str, Any]) -> Any:
    """Make a message of this class with these fields. Raises InvalidRequest."""
    try:
        return from_builtins(cls, fields)
    except FieldError as error:
        raise _unknown_field(cls, fields) or not_populated(error) from None


def _unknown_field(cls: Any, fields: dict[str, Any]) -> InvalidRequest | None:
    """Return the error for the first unknown field, with ros2's text; None if all are known."""
    from srvgen.definitions.names import did_you_mean

    known = [name for name, _ in cls._FIELDS]
    for name, value in fields.items():
        if name not in known:
            problem = f"'{cls.__name__}' object has no attribute '{name}'"
            has = f"{cls.__name__} has {', '.join(known) or 'no fields'}"
            similar = did_you_mean(name, known)
            return hinted(not_populated(problem), f"{has}; {similar}" if similar else has)
        nested = cls._NESTED.get(name)
        is_mapping = nested is not None and isinstance(value, dict)
        if is_mapping and (error := _unknown_field(nested, value)):
            return error
    return None


def read_fields(cls: Any, values: Sequence[str]) -> dict[str, Any]:
    """Read the fields of a message from a command line. Raises InvalidRequest."""
    try:
        return _read(cls, values)
    except FieldError as error:
        raise not_populated(error) from None


def _read(cls: Any, values: Sequence[str]) -> dict[str, Any]:
    if not values:
        return {}
    _refuse_commas(cls, values)
    if all(_ASSIGNMENT.fullmatch(value) for value in values):
        return _Assignments(cls).read(values)
    hint = quoting.request_hint(values)
    text = next(each for each in values if not _ASSIGNMENT.fullmatch(each))
    if len(values) > 1 or quoting.begins_curly(text):
        problem = f"expected one YAML text, or only FIELD=VALUE; got {text!r}"
        raise hinted(InvalidRequest("", problem), hint)
    fields = simple_mapping(cls, text)
    if fields is None:
        # Importing PyYAML takes longer than the rest of a call.
        from taskrpc.cli.shared.yaml_values import read_mapping

        fields = read_mapping(cls, text, hint)
    return fields


def _refuse_commas(cls: Any, values: Sequence[str]) -> None:
    """Refuse `a=1, b=2`: the comma, or all of the rest, would become part of a string field."""
    names = "|".join(re.escape(name) for name, _ in cls._FIELDS)
    text = " ".join(values)
    if not names:
        return
    if _ASSIGNMENT.fullmatch(values[0]) and (found := re.search(rf",\s*({names})=", text)):
        spaced = re.sub(rf",\s*({names})=", r" \1=", text)
        problem = f"expected FIELD=VALUE separated by spaces, got a comma before {found[1]}="
        raise hinted(InvalidRequest("", problem), f"write {spaced}")


def simple_mapping(cls: Any, text: str) -> dict[str, Any] | None:
    """Return the fields of a simple `{name: value, …}`, or None if only YAML can read the text."""
    if not (text.startswith("{") and text.endswith("}")):
        return None
    types = dict(cls._FIELDS)
    values: dict[str, Any] = {}
    for pair in text[1:-1].split(", "):
        name, _, word = pair.partition(": ")
        value = simple_value(word, types.get(name, ""))
        if value is None or name in values:
            return None
        values[name] = value
    return values


def simple_value(text: str, type_: str) -> Any:
    """Return the value of a simple number or word, as YAML reads it; None if only YAML can."""
    found = _SIMPLE.fullmatch(text)
    if found is None or not type_ or "[" in type_:
        return None
    if type_.startswith(("string", "wstring")):
        return text
    if found["number"]:
        return float(text) if "." in text else int(text)
    return text == "true" if type_ == "bool" and text in ("true", "false") else None


class _Assignments:
    """Collects FIELD=VALUE arguments into the fields of one message."""

    def __init__(self, cls: Any) -> None:
        self._cls = cls
        self._values: dict[str, Any] = {}

    def read(self, values: Sequence[str]) -> dict[str, Any]:
        """Return the fields as one nested dict."""
        for argument in values:
            path, _, text = argument.partition("=")
            self._set(path, self._value(path, text))
        return self._values

    def _set(self, path: str, value: Any) -> None:
        *outer, name = path.split(".")
        table = self._values
        for each in outer:
            inner = table.setdefault(each, {})
            if not isinstance(inner, dict):
                raise FieldError(path, "given twice")
            table = inner
        if name in table:
            raise FieldError(path, "given twice")
        table[name] = value

    def _value(self, path: str, text: str) -> Any:
        type_, nested = self._type_of(path)
        if quoting.begins_curly(text):
            hint = quoting.request_hint([text])
            problem = f"{path}: {text} begins with a quotation mark that shells do not know"
            raise hinted(not_populated(problem), hint)
        if type_.startswith(("string", "wstring")) and "[" not in type_:
            return text
        simple = simple_value(text, type_)
        if simple is not None:
            return simple
        from taskrpc.cli.shared.yaml_values import Reader

        reader = Reader(text)
        if reader.node is None:
            raise FieldError(path, f"expected {type_ or 'a value'}, got nothing")
        return reader.value(reader.node, type_, nested)

    def _type_of(self, path: str) -> tuple[str, Any]:
        """Return a field's type and message class; "" and None if there is no such field."""
        cls, type_ = self._cls, ""
        for name in path.split("."):
            if cls is None or "[" in type_:
                return "", None
            type_ = dict(cls._FIELDS).get(name, "")
            cls = cls._NESTED.get(name)
        return type_, cls
