"""Parses the values of constants and defaults by the rules of the official tools."""

from __future__ import annotations

import re

from ..errors import InvalidText, Repair
from .model import FieldType, Scalar, Value

INTEGER_RANGES = {
    "byte": (0, 255),
    "char": (0, 255),
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
}
"""The smallest and the largest value of each integer type."""

CURLY = "\u201c\u201d\u201e\u2018\u2019"
"""The quotation marks of word processors; definitions accept only straight ones."""

_BOOLS = {"true": True, "1": True, "false": False, "0": False}
_ESCAPE = r"""\\(?:u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8}|x[0-9a-fA-F]{2}|[0-7]{1,3}|[abfnrtv\\'"])"""
"""Python compiles the pattern when a string first needs it: few definitions have escapes."""


def parse_scalar(text: str, base: str, string_bound: int | None = None) -> Scalar:
    """Parse one literal of a built-in type. Strings keep their backslash escapes.

    Raises:
        InvalidText: the text is not a value of this type.
    """
    if base in INTEGER_RANGES:
        return _integer(text, base)
    if base in ("float32", "float64"):
        return _float(text, base)
    if base == "bool":
        value = _BOOLS.get(text.lower())
        if value is None:
            raise InvalidText(f"expected true, false, 1 or 0 for bool, got {text!r}")
        return value
    if base in ("string", "wstring"):
        return _string(text, base, string_bound)
    raise InvalidText(f"{base!r} is a ROS 1 type that takes no value here, got {text!r}")


def parse_default(text: str, field_type: FieldType) -> Value:
    """Parse the default of a field.

    Raises:
        InvalidText: the text is not a value of this type; `offset` counts in `text`.
    """
    if not field_type.is_primitive:
        raise InvalidText(
            f"a field of the message type {field_type} can have no default, got {text!r}"
        )
    if not field_type.is_array:
        return parse_scalar(text, field_type.base, field_type.string_bound)
    if not (text.startswith("[") and text.endswith("]")):
        raise InvalidText(f"expected a default in brackets [...] for {field_type}, got {text!r}")
    elements = _elements(text, field_type)
    _check_count(len(elements), field_type)
    return tuple(_element(element, start, field_type) for start, element in elements)


def unescape(value: str) -> str:
    r"""Resolve the backslash escapes of a string literal.

    `describe` shows literals as they are in the file; classes have the resolved text, as after
    the .idl step of the official tools. An unknown escape such as `\d` is not changed.
    """
    if "\\" not in value:
        return value
    return re.sub(_ESCAPE, _resolved_escape, value)


def _check_escapes(text: str) -> None:
    """Refuse an escape that stands for half of a surrogate pair: no text of ROS can have it."""
    for match in re.finditer(_ESCAPE, text):
        if "\ud800" <= _resolved_escape(match) <= "\udfff":
            raise InvalidText(
                f"expected text that UTF-8 can encode, got the lone surrogate {match[0]}",
                hint="write the character itself, or its whole number after \\U",
            )


def _resolved_escape(match: re.Match[str]) -> str:
    escape = match[0]
    try:
        return escape.encode("ascii").decode("unicode_escape")
    except UnicodeDecodeError:  # \U with a number beyond Unicode
        return escape


def _integer(text: str, base: str) -> int:
    low, high = INTEGER_RANGES[base]
    try:
        value = int(text)
    except ValueError:
        try:
            value = int(text, 0)
        except ValueError:
            raise _invalid_integer(text, base) from None
    if not low <= value <= high:
        raise InvalidText(f"expected a whole number from {low} to {high} for {base}, got {text!r}")
    return value


def _invalid_integer(text: str, base: str) -> InvalidText:
    low, high = INTEGER_RANGES[base]
    error = InvalidText(f"expected a whole number from {low} to {high} for {base}, got {text!r}")
    if re.fullmatch("'.'", text):
        code = ord(text[1])
        error.hint = f"a {base} is a number here: {code}"
        if base in ("char", "byte") and code < 128:
            error.repair = Repair(0, len(text), str(code))
    return error


def _float(text: str, base: str) -> float:
    try:
        return float(text)
    except ValueError:
        error = InvalidText(f"expected a number for {base}, got {text!r}")
        if re.fullmatch(r"[-+]?\d+,\d+", text):
            meant = text.replace(",", ".")
            error.hint = f"write a decimal point: {meant}"
            error.repair = Repair(0, len(text), meant)
        raise error from None


def _string(text: str, base: str, bound: int | None) -> str:
    if "\\" in text:
        _check_escapes(text)
    for quote in ('"', "'"):
        if text.startswith(quote) and text.endswith(quote):
            text = text[1:-1]
            inner = re.search(rf"(?<!\\){quote}", text)
            if inner:
                raise InvalidText(
                    f"expected no bare {quote} inside the quoted string",
                    inner.start() + 1,
                    hint=f"write \\{quote} for a quotation mark in the text",
                )
            text = text.replace("\\" + quote, quote)
            break
    if bound and len(text) > bound:
        raise InvalidText(
            f"expected at most {bound} characters for {base}<={bound}, got {len(text)}"
        )
    return text


def _element(text: str, start: int, field_type: FieldType) -> Scalar:
    stripped = text.strip()
    try:
        return parse_scalar(stripped, field_type.base, field_type.string_bound)
    except InvalidText as error:
        raise error.moved(start + len(text) - len(text.lstrip())) from None


def _check_count(count: int, field_type: FieldType) -> None:
    size = field_type.array_size
    if size is None or count == size or (field_type.is_upper_bound and count < size):
        return
    limit = "at most" if field_type.is_upper_bound else "exactly"
    plural = "" if size == 1 else "s"
    raise InvalidText(f"expected {limit} {size} element{plural} for {field_type}, got {count}")


def _elements(text: str, field_type: FieldType) -> list[tuple[int, str]]:
    """The elements of `[a, b]` with their offsets in the text."""
    inner = text[1:-1]
    if field_type.base in ("string", "wstring"):
        return _string_elements(inner)
    elements = []
    start = 1
    for element in inner.split(",") if inner else ():
        elements.append((start, element))
        start += len(element) + 1
    return elements


def _string_elements(inner: str) -> list[tuple[int, str]]:
    """Split at commas outside quotes. One trailing comma is allowed, as in Python."""
    elements = []
    at = 0
    while at < len(inner):
        at = _after_spaces(inner, at)
        if at == len(inner) or inner[at] == ",":
            raise InvalidText("expected an element of the array here", at + 1)
        end, element = _string_element(inner, at)
        elements.append((at + 1, element))
        at = _after_spaces(inner, end)
        at += inner.startswith(",", at)
    return elements


def _after_spaces(text: str, at: int) -> int:
    found = re.compile(" +").match(text, at)
    return found.end() if found else at


def _string_element(inner: str, at: int) -> tuple[int, str]:
    quote = inner[at]
    if quote not in "\"'":
        comma = inner.find(",", at)
        end = len(inner) if comma < 0 else comma
        return end, inner[at:end]
    closing = re.compile(rf"(?<!\\){quote}").search(inner, at + 1)
    if closing is None:
        raise InvalidText(f"expected a closing {quote} for the string that begins here", at + 1)
    return closing.end(), inner[at + 1 : closing.start()].replace("\\" + quote, quote)
